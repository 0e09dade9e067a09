import math

import pytest

from riot_bus.inject.plan import parse_plan, read_plan
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Curve, Formula, Injection, Signal
from tests.plans import plan_to_toml


@pytest.fixture
def plan(tmp_path):
    def write(text):
        path = tmp_path / "plan.toml"
        path.write_text(text)
        return path

    return write


def test_everything_is_read(plan):
    injections = read_plan(
        plan(
            """
            seed = 7
            [[inject]]
            topic = "/odom"
            field = "twist.twist.linear.x"
            value = nan
            start = 2
            end = 4.5
            first = 1
            last = 3
            where = "mode == 2"
            probability = 0.5
            [[inject]]
            topic = "a/**"
            field = "x"
            signal = { center = 1.0, amplitude = 2, hold = 3 }
            seed = 9
            [[inject]]
            topic = "b"
            fault = "delay"
            delay = 0.25
            [[inject]]
            topic = "c"
            field = "len(data)"
            formula = "width * height"
            [[inject]]
            topic = "b"
            field = "blob"
            value = { hex = "00ff" }
            """
        )
    )
    first = injections[0]
    assert math.isnan(first.value)
    assert (first.start, first.end, first.first, first.last, first.seed) == (2.0, 4.5, 1, 3, 7)
    assert injections[1].value == Signal(1.0, 2.0, 3, 7)
    assert injections[1].seed == 9
    assert injections[2] == Injection("b", fault="delay", delay=0.25, seed=7)
    assert injections[3] == Injection("c", "len(data)", Formula("width * height"), seed=7)
    assert injections[4].value == b"\x00\xff"


def test_round_trip(plan):
    injections = (
        Injection("/odom", "x", 1.5, start=1.0, end=2.0, where='mode == 2 and name == "a\\n"', seed=3),
        Injection("a", "x", 'text "with" \\ and \n\x00 \U0001f916'),
        Injection("a", "x", b"\x00"),
        Injection("a", "flag", False),
        Injection("a", "n", -(2**63)),
        Injection("a", "x", float("-inf")),
        Injection("a", "x", Signal(1.0, 0.5, 2, 11, integer=True)),
        Injection("a", "x", Signal(0.5, 0.999, 2, 11, integer=True, choices=("on", "off"))),
        Injection("a", "x", Curve((0.0, 1.5), (3.0, -4.0))),
        Injection("a", "len(x)", Formula("2 * len(x) + 1")),
        Injection("a", "b[0].x", Formula("name == 'a\"b'", base="b[0]")),
        Injection("a", fault="drop", probability=0.25),
        Injection("a", fault="duplicate", copies=3),
    )
    assert read_plan(plan(plan_to_toml(injections))) == injections


@pytest.mark.parametrize(
    ("text", "where", "problem"),
    [
        ("[[inject]]\ntopic='a'\nfeild='x'\nvalue=1", "inject[0].feild", "did you mean 'field'"),
        ("sed=1", "sed", "did you mean 'seed'"),
        ("[[inject]]\ntopic='a'\nfield='x'\nsignal={center=1,amplitude=1,hld=2}", "inject[0].signal.hld", "'hold'"),
        ("[[inject]]\nfield='x'\nvalue=1", "inject[0].topic", "required"),
        ("[[inject]]\ntopic='a'\nvalue=1", "inject[0]", "which field"),
        ("[[inject]]\ntopic='a'\nfield='x'", "inject[0]", "either value, signal, curve or formula"),
        ("[[inject]]\ntopic='a'\nfault='dorp'", "inject[0].fault", "did you mean 'drop'"),
        ("[[inject]]\ntopic='a'\nfault='drop'\nfield='x'", "inject[0]", "takes no field"),
        ("[[inject]]\ntopic='a'\nfault='delay'", "inject[0]", "delay = SECONDS"),
        ("[[inject]]\ntopic='a'\nfault='drop'\nprobability=1.5", "inject[0].probability", "1.5"),
        ("[[inject]]\ntopic='a'\nfault='drop'\nstart=3\nend=2", "inject[0]", "not later"),
        ("[[inject]]\ntopic='a'\nfault='drop'\nfirst=3\nlast=2", "inject[0]", "before"),
        ("[[inject]]\ntopic='a'\nfault='drop'\ncopies=2", "inject[0]", "copies"),
        ("[[inject]]\ntopic='a'\nfault='drop'\nwhere='mode = 2'", "inject[0].where", "="),
        ("[[inject]]\ntopic='/a:x'\nfault='drop'", "inject[0].topic", "field = "),
        ("[[inject]]\ntopic='a'\nfield='x y'\nvalue=1", "inject[0].field", "field path"),
        ("[[inject]]\ntopic='a'\nfield='x'\nformula='y +'", "inject[0].formula", "cannot read"),
        ("[[inject]]\ntopic='a'\nfield='x'\nformula={txt='y'}", "inject[0].formula.txt", "did you mean 'text'"),
        ("[[inject]]\ntopic='a'\nfield='x'\nformula={text='y', base='b c'}", "inject[0].formula", "field path"),
        (
            "[[inject]]\ntopic='a'\nfield='x'\nformula='y'\nvalue=1",
            "inject[0]",
            "either value, signal, curve or formula",
        ),
        ("[[inject]]\ntopic='a'\nfield='x'\ncurve={times=[0],valeus=[1]}", "inject[0].curve.valeus", "mean 'values'"),
        ("[[inject]]\ntopic='a'\nfield='x'\ncurve={times=[0,1],values=[1]}", "inject[0].curve", "as many values"),
        ("[[inject]]\ntopic='a'\nfield='x'\ncurve={times=[1,1],values=[1,2]}", "inject[0].curve", "have to rise"),
        ("[[inject]\n", "plan.toml", "not a TOML file"),
    ],
)
def test_errors_name_file_and_key(plan, text, where, problem):
    path = plan(text)
    with pytest.raises(ConfigError) as caught:
        read_plan(path)
    assert str(path) in str(caught.value)
    assert where in caught.value.where
    assert problem in str(caught.value)


def test_missing_file(tmp_path):
    with pytest.raises(ConfigError, match="cannot read"):
        read_plan(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("text", "place"),
    [("int = 1", "p: int"), ("[[str]]\na = 1", "p: str"), ('[[inject]]\ntopic = "a"\nfloat = 1', r"inject\[0\].float")],
)
def test_unknown_keys_may_be_called_like_types(text: str, place: str) -> None:
    with pytest.raises(ConfigError, match=f"{place}: unknown key"):
        parse_plan(text, name="p")
