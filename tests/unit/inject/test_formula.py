import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.inject.formula import evaluate, join_path, parse_formula
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus.vocabulary.injection import Formula
from tests.tiers import scaled

FIELDS = {"w": 4, "h": 3, "len(data)": 12, "x": 0.5, "name": "home", "a.b[2].c": -3, "len(a.b[2].d)": 7, "on": True,
          "bad": math.nan, "len": 1}  # fmt: skip


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("len(data) == w * h", True),
        ("len(data) == w * h + 1", False),
        ("w + 1", 5),
        ("-x", -0.5),
        ("2 ** 32 - w", 2**32 - 4),
        ("w // 2 + w % 3 - +1", 2),
        ("a.b[2].c * len(a.b[2].d)", -21),
        ("0 <= x < 1 <= w", True),
        ("not (x > 1 or w == 3) and on", True),
        ("on == true and name == 'home'", True),
        ("max(abs(a.b[2].c), min(w, h)) / 2", 1.5),
        ("isfinite(bad)", False),
        ("bad == bad", False),
        ("'rgb8'", "rgb8"),
        ("name", "home"),
        ("0x10 + 1e3", 1016.0),
        ("-inf < x", True),
    ],
)
def test_meaning(text, value):
    assert parse_formula(text)(FIELDS.__getitem__) == value


@pytest.mark.parametrize(
    "text",
    [
        "w / 0",
        "w % 0",
        "name + 1",
        "name < 1",
        "abs(name)",
        "1e308 ** 2",
        "10 ** 10 ** 10",
        "(0 - 1) ** 0.5",
        "((w ** 999) ** 999) ** 999",
        "-name",
    ],
)
def test_what_has_no_value_is_an_error_of_the_payload(text):
    with pytest.raises(PayloadError):
        parse_formula(text)(FIELDS.__getitem__)


@pytest.mark.parametrize(
    "text",
    ["", "w +", "w = 1", "open('x')", "__import__('os').system('x')", "w.__class__()", "[w]", "lambda: 1",
     "w if h else x",
     "x[1:2]", "x['a']", "w in h", "w @ h", "w | h", "abs()", "abs(x, key=1)", "f'{w}'", "(w := 1)", "1j",
     "None", "w, h",
     "len(1)", "len(w + h)", "b'x'", "-" * 2000 + "1", "(" * 300 + "1" + ")" * 300, "--" * 45 + "1", "\0"],
)  # fmt: skip
def test_what_is_no_formula(text):
    with pytest.raises(ConfigError):
        parse_formula(text)


def test_fields_and_literals_are_told():
    assert parse_formula("w * h == len(data) and w > nan").fields == ("w", "h", "len(data)")
    assert parse_formula("'a b'").literal == "a b"
    assert parse_formula("name").literal is None


def test_base_is_put_before_every_path():
    assert join_path("a[0].b", "len(c[1].d)") == "len(a[0].b.c[1].d)"
    assert join_path("", "x") == "x"
    read = {"p.q.w": 2, "len(p.q.data)": 5}.__getitem__
    assert evaluate(Formula("len(data) - w", base="p.q"), read) == 3


@settings(deadline=None, max_examples=scaled(300))
@given(st.text("wh x1.0[]()'\"+-*/%<>=!,andortlesif:\n\\", max_size=30))
def test_any_text_is_a_formula_or_a_config_error(text):
    try:
        formula = parse_formula(text)
    except ConfigError:
        return
    try:
        value = formula(lambda path: FIELDS.get(path, 1))
    except PayloadError:
        return
    assert isinstance(value, bool | int | float | str)
