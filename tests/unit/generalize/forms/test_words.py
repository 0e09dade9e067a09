import ast
import keyword

from riot_bus.generalize.features import Feature
from riot_bus.generalize.forms.words import comparison, identifiers, is_misfit, line
from riot_bus.generalize.literals import Literal

NAMES = [
    "/odom:pose.x",
    "/odom:pose_x",
    "odom_pose_x",
    "",
    "9",
    "int",
    "lambda",
    "always",
    "v",
    "é",
    "a" * 300,
    "X",
    "x",
]


def test_words_are_identifiers_that_nothing_else_has() -> None:
    words = identifiers(NAMES)
    assert list(words) == NAMES
    assert len(set(words.values())) == len(NAMES)
    for word in words.values():
        assert word.isidentifier()
        assert word.isascii()
        assert not keyword.iskeyword(word)
        assert "__" not in word
    assert not {"int", "lambda", "always", "v"} & set(words.values())
    assert words["/odom:pose.x"] == "odom_pose_x"


def test_a_line_is_one_line_and_a_string() -> None:
    for text in ("plain", 'a"b\\\n\u2028c', "\\", "\x1b[2J"):
        shown = line(text)
        assert shown.isprintable()
        assert shown.isascii()
        assert shown.count('"') == 2
        assert isinstance(ast.literal_eval(shown), str)


def compared(operator: str, value: float, *, floating: bool = False) -> object:
    return comparison(Literal(Feature("raw", ("x",)), operator, value), floating=floating)


def test_thresholds_take_the_type_of_the_feature() -> None:
    assert compared(">", 3, floating=True) == (">", 3.0)
    assert compared(">=", 2.5) == (">", 2)
    assert compared("<", 2.5) == ("<=", 2)
    assert compared("<=", -2.5) == ("<=", -3)
    assert compared("==", 4.0) == ("==", 4)
    assert compared("==", 2.5) is False
    assert compared("!=", 2.5) is True


def test_a_literal_of_another_type_never_holds() -> None:
    types = {"x": "int8", "mode": "string", "flag": "bool"}
    assert is_misfit(Literal(Feature("raw", ("x",)), "==", "auto"), types)
    assert is_misfit(Literal(Feature("raw", ("mode",)), ">", 3), types)
    assert is_misfit(Literal(Feature("raw", ("mode",)), "!=", True), types)
    assert not is_misfit(Literal(Feature("raw", ("mode",)), "==", "auto"), types)
    assert not is_misfit(Literal(Feature("add", ("x", "flag")), ">", 3), types)
