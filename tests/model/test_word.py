"""Words: what is written is what is read, and every misspelling has its message."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socp.errors import MethodError
from socp.model.word import Mode, Word

MODES = st.one_of(
    st.sampled_from(
        [Mode("lower"), Mode("upper"), Mode("singular"), Mode("boundary"), Mode("free")]
    ),
    st.sampled_from(["u.upper", "wall", "x.lower"]).map(lambda name: Mode("boundary", name)),
)


@st.composite
def words(draw: st.DrawFn) -> Word:
    controls = draw(
        st.lists(st.sampled_from(["r", "f", "thrust", "u1"]), min_size=1, max_size=4, unique=True)
    )
    arcs = draw(st.lists(st.tuples(*[MODES] * len(controls)), min_size=1, max_size=6))
    return Word(tuple(controls), tuple(arcs))


@given(words())
def test_parse_reads_what_str_writes(word: Word) -> None:
    assert Word.parse(str(word), word.controls) == word


@given(words(), st.randoms(use_true_random=False))
def test_rows_may_come_in_any_order(word: Word, random: object) -> None:
    rows = str(word).split(";")
    random.shuffle(rows)  # type: ignore[attr-defined]
    assert Word.parse(" ; ".join(rows), word.controls) == word


@pytest.mark.parametrize(
    ("short", "long"),
    [
        ("+", "upper"),
        ("+", "UP"),
        ("-", "lower"),
        ("-", "lo"),
        ("s", "sing"),
        ("s", "Singular"),
        ("b", "bdry"),
        ("b[wall]", "boundary[wall]"),
        ("*", "free"),
    ],
)
def test_long_names_mean_the_same(short: str, long: str) -> None:
    assert Mode.parse(long) == Mode.parse(short)
    assert str(Mode.parse(long)) == short


def test_the_only_control_needs_no_name() -> None:
    assert Word.parse("+ s -", ["f"]) == Word.parse("f: + s -", ["f"])


def test_one_control_with_equal_neighbours_merged() -> None:
    word = Word.parse("r: + s s s +; f: + + b - -", ["r", "f"])
    assert word.of("r") == "+ s +"
    assert word.of("f") == "+ b -"
    assert len(word.arcs) == 5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "r: + x; f: + +",
            "'x' is no kind of arc; write + (upper bound), - (lower bound), s (singular)",
        ),
        (
            "r: +[wall]; f: +",
            "'+[wall]' names a constraint, which only a boundary arc has: b[wall]",
        ),
        ("r: b[; f: +", "'b[' is no kind of arc"),
        ("r: b[]; f: +", "'b[]' is no kind of arc"),
        ("r: + s; f: +", "every control needs one mode an arc, but r has 2, f has 1"),
        ("r: + s", "no arcs for control 'f'; write one row a control, such as 'f: + s -'"),
        ("r: ; f: +", "no arcs for control 'r'"),
        ("", "no arcs for control 'r'"),
        ("r: +; r: -; f: +", "control 'r' is given twice"),
        ("q: +; f: +", "'q: +' should start with a control and a colon; controls: r, f"),
        ("+ s", "'+ s' should start with a control and a colon; controls: r, f"),
    ],
)
def test_misspelt_words_are_refused(text: str, message: str) -> None:
    with pytest.raises(MethodError) as caught:
        Word.parse(text, ["r", "f"])
    assert message in str(caught.value)


@given(st.text(max_size=20))
def test_any_other_text_is_a_method_error(text: str) -> None:
    try:
        word = Word.parse(text, ["r", "f"])
    except MethodError as error:
        assert str(error).startswith("word: ")  # noqa: PT017 - most texts fail, some are words
    else:
        assert Word.parse(str(word), word.controls) == word


def spelt(text: str) -> list[str]:
    return [str(word) for word in Word.readings(text, ["r", "f"])]


def test_stretches_are_read_in_every_order_of_their_switches() -> None:
    found = spelt("r: + s +; f: + -")
    assert sorted(found) == [
        "r: + + s +; f: + - - -",
        "r: + s + +; f: + + + -",
        "r: + s s +; f: + + - -",
    ]
    assert found[0] == "r: + s s +; f: + + - -"
    assert all(word.of("r") == "+ s +" for word in Word.readings("r: + s +; f: + -", ["r", "f"]))


def test_one_mode_an_arc_is_one_word() -> None:
    for text in ("r: + s s; f: + + b[a,|]", "r: + | s; f: + | -", "r: s; f: s"):
        assert len(spelt(text)) == 1
    assert len(Word.readings("+ s + -", ["u"])) == 1


def test_commas_and_bars_tell_the_two_readings_apart() -> None:
    assert spelt("r: + | s; f: + | -") == ["r: + s; f: + -"]
    assert sorted(spelt("r: +, s; f: +, -")) == ["r: + + s; f: + - -", "r: + s s; f: + + -"]
    with pytest.raises(MethodError, match=r"two readings: write 'r: . . s; f: . . -' if all"):
        spelt("r: + s; f: + -")


def test_too_many_orders_are_refused() -> None:
    with pytest.raises(MethodError, match="may follow in 462 orders"):
        spelt("r: + - + - + - +; f: +, - + - + -")
