from __future__ import annotations

import tomllib

from hypothesis import given
from hypothesis import strategies as st

from riot_bus.vocabulary.redaction import escape_control_chars as _comment
from riot_bus.vocabulary.toml_text import toml_string


@given(st.text(st.characters(exclude_categories=["Cs"])))
def test_any_text_comes_back_and_stays_on_its_line(text: str) -> None:
    line = f"x = {toml_string(text)}  # {_comment(text)}"
    assert len(line.splitlines()) == 1
    assert tomllib.loads(line) == {"x": text}
