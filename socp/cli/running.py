"""Methods made and run: whoever wrote one that fails is named, and is not taken for socp."""

from collections.abc import Iterable
from contextlib import nullcontext
from numbers import Real
from typing import TYPE_CHECKING, Any

from socp.cli.options import build
from socp.errors import ContractError, SocpError
from socp.process import heard, listens
from socp.registry import Plugin, Registry, civil, explain, origin, prints_aside

if TYPE_CHECKING:
    from socp.methods import Method
    from socp.model import Problem, Solution, Watch

_OWN = "socp"  # the package whose plugins are socp's own: what fails there is a bug


def made(registry: Registry, name: str, given: Iterable[tuple[str, str]]) -> "Method":
    """Return a method of a name with its options; ContractError names the plugin whose method
    cannot be made.
    """
    method = registry.method(name)
    try:
        return build(method, given)
    except SocpError:
        raise
    except Exception as error:
        raise _blamed(registry, name, error) from error


def run_method(
    registry: Registry, method: "Method", problem: "Problem", guess: "Solution", watch: "Watch"
) -> "Solution":
    """Run a method as `socp.methods.chain.run` does; what it must not do becomes a ContractError
    that names its plugin.
    """
    from socp.methods import run

    stranger = _stranger(registry, method.name)
    try:
        with prints_aside() if stranger else nullcontext():
            return run(method, problem, guess, _strict(watch) if stranger else watch)
    except ContractError as error:
        raise _blamed(registry, method.name, error) from error
    except SocpError:
        raise
    except KeyboardInterrupt as error:
        if heard() or not listens() or stranger is None:
            raise
        raise _blamed(registry, method.name, error) from error
    except (Exception, SystemExit, GeneratorExit) as error:
        if stranger is None and isinstance(error, Exception):
            raise
        raise _blamed(registry, method.name, error) from error


def _stranger(registry: Registry, method: str) -> Plugin | None:
    """Return the plugin of a method, unless it is one of socp's own."""
    owner = registry.owner(method)
    return owner if owner is not None and owner.package.split()[0] != _OWN else None


def _blamed(registry: Registry, method: str, error: BaseException) -> Exception:
    """Return an error that names the plugin of a method; what went wrong in one of socp's own stays
    as it is.
    """
    owner = registry.owner(method)
    if owner is None:
        return civil(error)
    if _stranger(registry, method) is None and not isinstance(error, ContractError):
        return civil(error)
    said = explain(civil(error), origin(owner.target))
    text = said if said.startswith("method ") else f"method '{method}': {said}"
    return ContractError(f"{owner.who}: {text}")


def _strict(watch: "Watch") -> "Watch":
    """Return a watch that refuses what is no progress."""
    from socp.model import Progress, silent

    def see(now: Any, /) -> bool:
        """Pass progress on; ContractError for what is none."""
        if not isinstance(now, Progress):
            raise ContractError(f"it told its watch of {now!r:.60}, where a Progress is needed")
        for name, kind in {
            "stage": str,
            "word": str,
            "iteration": int,
            "objective": Real,
            "infeasibility": Real,
            "best": Real,
            "violation": Real,
        }.items():
            value = getattr(now, name)
            if not isinstance(value, kind):
                raise ContractError(
                    f"it told its watch of a Progress whose {name} is {value!r:.60}"
                )
        return watch(now)

    return silent if watch is silent else see
