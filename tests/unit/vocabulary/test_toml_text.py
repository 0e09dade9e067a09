from __future__ import annotations

import tomllib

from hypothesis import given
from hypothesis import strategies as st

from riot_bus.vocabulary.redaction import escape_control_chars as _comment
from riot_bus.vocabulary.toml_text import toml_string, toml_value


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
