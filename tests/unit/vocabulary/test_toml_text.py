from __future__ import annotations

import contextlib
import time
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.redaction import escape_control_chars as _comment
from riot_bus.vocabulary.toml_text import parse_toml, toml_string, toml_value

MIB = 1 << 20
key = st.lists(st.sampled_from(["a", "b-c", "1", '"x.y"', "'q\"'", '"\\""']), min_size=1, max_size=24).map(" . ".join)


@given(st.text(st.characters(exclude_categories=["Cs"])))
def test_any_text_comes_back_and_stays_on_its_line(text: str) -> None:
    line = f"x = {toml_string(text)}  # {_comment(text)}"
    assert len(line.splitlines()) == 1
    assert tomllib.loads(line) == {"x": text}


def test_keys_of_an_inline_table_are_quoted_where_they_have_to_be() -> None:
    table = {"PLAIN-1": "a", "with space": "b", 'a"b': ["c", True, {"": 1.5}]}
    text = toml_value(table)
    assert text.startswith('{ PLAIN-1 = "a", "with space" = ')
    assert tomllib.loads(f"x = {text}") == {"x": table}


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a." * (MIB // 2) + "a = 1", "x.toml:1: 'a.a"),  # hours
        ("\n[[" + "a." * 16 + "a]]", "x.toml:2: 'a.a"),
        ('"a\\"" .\'b\'.\t' * 9 + "c = 1", "too long"),
        ("x = " + "1" * 5000, "not a TOML file: Exceeds the limit"),
        ("x = [-1, 0x" + "f" * 5000 + "]", "x.toml:1: '0xfff"),  # which could not be shown
        ("x = " + "[" * MIB, "not a TOML file"),
        ("x = {a=" * 5000, "not a TOML file"),
        ("x = ", "not a TOML file"),
    ],
    ids=["dots", "header", "quotes", "digits", "hex", "arrays", "tables", "nothing"],
)
def test_what_would_take_long_or_raise_something_else_is_refused(text: str, problem: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_toml(text, where="x.toml")
    assert problem in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    "unit", ['"\\"', '""', "''", "a", "a ", "a.a ", " .", '"."', "\\", "-", "a\n", '"a" . ', "0x", "'.\""]
)
def test_looking_for_long_keys_takes_a_time_that_grows_with_the_text(unit: str) -> None:
    began = time.process_time()
    for before in ("", '"', "x = '"):
        with contextlib.suppress(ConfigError):
            parse_toml(before + unit * (MIB // len(unit)), where="x.toml")
    assert time.process_time() - began < 60  # 2 s; with the square of the length it would be hours


@given(key, st.sampled_from(["{} = 1", "[{}]", "x = {{ {} = 1 }}", "y = [\n{{ {} = 1.5 }}, 2]"]))
def test_keys_of_up_to_sixteen_parts_are_read_as_ever(text: str, place: str) -> None:
    document = place.format(text)
    if text.count(" . ") < 16:
        assert parse_toml(document, where="x") == tomllib.loads(document)
    else:
        with pytest.raises(ConfigError, match="is too long"):
            parse_toml(document, where="x")


def test_dots_that_join_no_keys_are_not_counted() -> None:
    document = 'a = "www.' + ".." * 40 + '"\nb = [' + "1.5, " * 100 + "]\nc = 0xff\nd = '0x" + "f" * 2000 + "'"
    assert parse_toml(document, where="x") == tomllib.loads(document)
