"""Options of methods from KEY=VALUE pairs, by the types of their fields."""

from collections.abc import Iterable, Sequence
from dataclasses import MISSING, Field, replace
from types import NoneType
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

from socp.errors import MethodError
from socp.process import short
from socp.registry import suggest

if TYPE_CHECKING:
    from socp.methods import Method

DEFAULT_METHOD = "auto"

_TRUTH = {
    "true": True,
    "yes": True,
    "on": True,
    "1": True,
    "false": False,
    "no": False,
    "off": False,
    "0": False,
}


def pairs(
    given: Iterable[str], option: str = "-o", example: str = "steps=400"
) -> list[tuple[str, str]]:
    """Split KEY=VALUE texts of an option; MethodError shows one that has no key or no equals sign,
    with an example.
    """
    found = []
    for text in given:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise MethodError(
                f"{option} {short(text)}: write KEY=VALUE, such as {option} {example}"
            )
        found.append((key.strip(), value.strip()))
    return found


def build(method: "type[Method]", given: Iterable[tuple[str, str]]) -> "Method":
    """Return a method with options set from their texts; MethodError names the unknown, missing or
    mistyped.
    """
    from socp.methods import check_options, is_required, named_backend, options

    fields = {each.name: each for each in options(method)}
    hints = get_type_hints(method)
    given, values = list(given), dict[str, Any]()
    for key, text in given:
        if key in fields and _swappable(fields[key], hints[key]):
            values[key] = named_backend(f"{method.name}: {key}", text)
    for key, text in given:
        holder, dot, inner = key.partition(".")
        if dot:
            name = _backend(method, fields, values, holder)
            values[name] = _with_option(values.get(name, _default(fields[name])), inner, text)
        elif key not in fields:
            raise MethodError(
                f"{method.name} has no option '{key}'{suggest(key, _settable(fields))}"
            )
        elif key not in values or not _swappable(fields[key], hints[key]):
            values[key] = _convert(f"{method.name}: {key}", hints[key], text)
    missing = [name for name, each in fields.items() if is_required(each) and name not in values]
    if missing:
        raise MethodError(f"{method.name} needs a value of '{missing[0]}': -o {missing[0]}=...")
    built = method(**values)
    check_options(built)
    return built


def options_by_method(
    methods: "Sequence[type[Method]]", given: Sequence[str]
) -> "dict[str, list[tuple[str, str]]]":
    """Sort the options of several methods: METHOD.KEY=VALUE is for one, KEY=VALUE for each that has
    the option.
    """
    found: dict[str, list[tuple[str, str]]] = {method.name: [] for method in methods}
    for key, text in pairs(given):
        head, dot, rest = key.partition(".")
        if dot and head in found:
            found[head].append((rest, text))
            continue
        takers = [method for method in methods if (head if dot else key) in option_keys(method)]
        if not takers:
            known = sorted(
                {name for method in methods for name in option_keys(method)} | set(found)
            )
            raise MethodError(f"no method here has an option '{key}'{suggest(head, known)}")
        for method in takers:
            found[method.name].append((key, text))
    return found


def option_keys(method: "type[Method]") -> set[str]:
    """Return the keys that a method takes: its options, and the names before the dot of its
    backends' options.
    """
    from socp.methods import options

    fields, hints = options(method), get_type_hints(method)
    return {name for each in fields for name in (each.name, *backends(each, hints[each.name]))}


def has_options(each: "Field[Any]") -> bool:
    """Tell whether an option is a backend that takes options of its own."""
    return hasattr(_default(each), "options")


def backends(each: "Field[Any]", hint: Any) -> list[str]:
    """Return the names of the backends that an option may be, its default first; none where it is
    no backend.
    """
    if not has_options(each):
        return []
    from socp.solvers import BACKENDS

    name = backend_name(each)
    others = BACKENDS if _swappable(each, hint) else ()
    return [name, *(other for other in others if other != name)]


def backend_name(each: "Field[Any]") -> str:
    """Return the name of a backend in front of its options, such as `ipopt`."""
    return _name(_default(each))


def _name(backend: Any) -> str:
    return str(getattr(backend, "name", type(backend).__name__.lower()))


def _swappable(each: "Field[Any]", hint: Any) -> bool:
    """Tell whether any backend will do for an option."""
    from socp.solvers import Backend

    return hint is Backend and has_options(each)


def _default(each: "Field[Any]") -> Any:
    if each.default_factory is not MISSING:
        return each.default_factory()
    return None if each.default is MISSING else each.default


def _settable(fields: "dict[str, Field[Any]]") -> list[str]:
    return [
        f"{backend_name(each)}.*" if has_options(each) else name for name, each in fields.items()
    ]


def _backend(
    method: "type[Method]", fields: "dict[str, Field[Any]]", values: dict[str, Any], holder: str
) -> str:
    """Return the field of the backend that a dotted key names."""
    hints = get_type_hints(method)
    chosen = {
        _name(values.get(name, _default(each))): name
        for name, each in fields.items()
        if has_options(each)
    }
    if holder in chosen:
        return chosen[holder]
    for name, each in fields.items():
        if holder in backends(each, hints[name]):
            now = _name(values.get(name, _default(each)))
            raise MethodError(
                f"{method.name}: {holder}: its {name} is {now}; add -o {name}={holder}"
            )
    names = [other for name, each in fields.items() for other in backends(each, hints[name])]
    raise MethodError(f"{method.name} has no backend '{holder}'{suggest(holder, names)}")


def _with_option(backend: Any, name: str, text: str) -> Any:
    return replace(backend, options={**backend.options, name: _number(text)})


def _number(text: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _convert(place: str, hint: Any, text: str) -> Any:
    """Return a text as the type of an option: int, float, bool, str, or one of these or None."""
    from socp.methods import WANTED

    kinds = get_args(hint) or (hint,)
    if NoneType in kinds and text.lower() == "none":
        return None
    kind = next((kind for kind in kinds if kind is not NoneType), str)
    if kind is str:
        return text
    if kind not in WANTED:
        raise MethodError(
            f"{place}: cannot be set as a whole; set its own options, such as -o ipopt.tol=1e-10"
        )
    try:
        if kind is int and "." not in text and "e" in text.lower() and float(text).is_integer():
            return int(float(text))  # 1e4 steps
        return _TRUTH[text.lower()] if kind is bool else kind(text)
    except (ValueError, KeyError, OverflowError):
        raise MethodError(f"{place}='{short(text)}', but it should be {WANTED[kind]}") from None
