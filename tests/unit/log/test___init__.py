from __future__ import annotations

import pytest

from riot_bus import log
from riot_bus.log.tables import table


def test_names_of_the_package_are_those_of_its_tables() -> None:
    assert {name: getattr(log, name) for name in log.__all__} == {name: getattr(table, name) for name in log.__all__}
    assert log.columns is table.columns
    with pytest.raises(AttributeError, match=r"'riot_bus\.log' has no attribute 'colums'"):
        log.colums  # type: ignore[attr-defined]  # noqa: B018
