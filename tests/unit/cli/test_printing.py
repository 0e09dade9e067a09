from __future__ import annotations

import math

from riot_bus.cli.printing import json_safe, table_console


def test_json_has_no_infinite_numbers() -> None:
    assert json_safe({"a": [1, math.inf, {"b": (math.nan, "x", None)}]}) == {"a": [1, "inf", {"b": ["nan", "x", None]}]}


def test_long_names_are_whole_where_there_is_no_terminal() -> None:
    assert table_console().width == 200
