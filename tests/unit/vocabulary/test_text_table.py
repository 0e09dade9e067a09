from __future__ import annotations

from riot_bus.vocabulary.text_table import table_lines

ROWS = [("topic", "kept", "as"), ("/odom", "10", ""), ("/a", "9999", "/b")]


def test_columns_are_as_wide_as_their_longest_cell():
    assert table_lines(ROWS, left=(0, 2)) == ["topic  kept  as", "/odom    10", "/a     9999  /b"]


def test_all_but_the_first_column_are_flush_right():
    assert table_lines(ROWS) == ["topic  kept  as", "/odom    10", "/a     9999  /b"]
    assert table_lines([("", "a"), ("b", "10")]) == ["    a", "b  10"]


def test_a_table_without_rows_has_no_lines():
    assert table_lines([]) == []
