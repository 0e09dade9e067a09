from __future__ import annotations

import pytest

import riot_bus_bridges


@pytest.mark.parametrize("name", ["Bridge", "BridgeHost"])
def test_each_name_is_there(name: str) -> None:
    assert getattr(riot_bus_bridges, name).__name__ == name


def test_other_names_are_not() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = riot_bus_bridges.nothing
