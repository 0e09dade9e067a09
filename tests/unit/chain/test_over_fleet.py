from __future__ import annotations

from pathlib import Path
from typing import Literal

import pytest

from riot_bus.chain.over_fleet import LogAnswer, _Answers, exit_code


@pytest.mark.parametrize(
    ("answers", "code"),
    [
        ([], 0),
        (["fixed", "fixed"], 0),
        (["fixed", "error"], 4),
        (["error", "failed", "fixed"], 1),
    ],
)
def test_exit_codes(answers: list[Literal["fixed", "failed", "error"]], code: int) -> None:
    assert exit_code([LogAnswer("/a.mcap", each) for each in answers]) == code


def test_answers_outlive_a_kill_in_the_middle_of_a_line(tmp_path: Path) -> None:
    path = tmp_path / "fleet" / "answers.jsonl"
    answers = _Answers(path)
    one, two = LogAnswer("/1.mcap", "fixed", trials=1), LogAnswer("/2.mcap", "failed", "why", 1, 1, 3, 9)
    key = answers.key(["fingerprint", 1, None])
    answers.put(key, one)
    answers.put("other", two)
    path.write_bytes(path.read_bytes()[:-5])
    again = _Answers(path)
    assert (again.get(key), again.get("other"), again.get("none")) == (one, None, None)
    again.put("other", two)
    assert _Answers(path).get("other") == two
    with path.open("a") as stream:
        stream.write('{"key": "odd", "answer": {"place": 1}}\n[]\n"x"\n')
    assert _Answers(path).get("odd") is None
