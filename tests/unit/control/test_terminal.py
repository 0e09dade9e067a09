from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from riot_bus.control.terminal import Foreground


def test_what_an_interceptor_raised_about_a_payload_moves_no_cursor() -> None:
    said: list[str] = []
    errors = SimpleNamespace(count=2, first='Traceback:\n\tFile "mine.py"\nValueError: bad \x1b[2J\x9b')
    pipeline: Any = SimpleNamespace(errors={"mine": errors})
    Foreground(said.append, said.append).warn_of_errors(pipeline)
    (told,) = said
    assert told.splitlines()[-1] == "ValueError: bad \\x1b[2J\\x9b"
    assert '\n\tFile "mine.py"\n' in told
