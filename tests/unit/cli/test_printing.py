from __future__ import annotations

import math

import pytest

from riot_bus.cli import printing
from riot_bus.cli.printing import json_safe, new_table, print_table, table_console


def test_json_has_no_infinite_numbers() -> None:
    assert json_safe({"a": [1, math.inf, {"b": (math.nan, "x", None)}]}) == {"a": [1, "inf", {"b": ["nan", "x", None]}]}


def test_long_names_are_whole_where_there_is_no_terminal() -> None:
    assert table_console().width == 200


@pytest.mark.parametrize(("rows", "more", "rich"), [(3, 0, True), (1001, 0, False), (3, 1000, False)])
def test_large_tables_are_printed_without_rich(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], rows: int, more: int, rich: bool
) -> None:
    used: list[bool] = []
    monkeypatch.setattr(printing, "table_console", lambda: used.append(True) or table_console())
    print_table(new_table("topic", numbers=["count"]), [(f"/a\x1b{n}", str(n)) for n in range(rows)], more=more)
    lines = capsys.readouterr().out.splitlines()
    assert used == [True] * rich
    assert [line.split() for line in lines] == [["topic", "count"], *([f"/a\\x1b{n}", str(n)] for n in range(rows))]


def test_a_long_name_does_not_make_all_rows_long(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [("/a", "1")] * 500 + [("x" * 1_000_000, "2")]
    print_table(new_table("topic", numbers=["count"]), rows)
    assert len(capsys.readouterr().out) < 1_200_000
