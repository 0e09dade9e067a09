from __future__ import annotations

import pytest

import riot_bus_logtools


@pytest.mark.parametrize("name", ["EditOptions", "edit"])
def test_each_name_is_there(name: str) -> None:
    assert getattr(riot_bus_logtools, name).__name__ == name


def test_other_names_are_not() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = riot_bus_logtools.nothing
