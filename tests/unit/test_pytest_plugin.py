"""What the plug-in does while tests are collected; the rest is in tests/integration."""

from __future__ import annotations

import pytest

from riot_bus.pytest_plugin import pytest_itemcollected


@pytest.fixture(scope="module")
def site() -> str:
    return "site"


@pytest.fixture
def robot() -> str:
    return "robot"


@pytest.mark.riot
def use(robot: str, site: str) -> None:
    """Stand for a test whose fixture starts a process."""


def test_the_marker_sets_up_riot_before_other_fixtures_of_the_test(request: pytest.FixtureRequest) -> None:
    item = pytest.Function.from_parent(request.node.parent, name="test_it", callobj=use)
    assert "riot" not in item.fixturenames
    pytest_itemcollected(item)
    names = item.fixturenames
    assert names.index("site") < names.index("riot") < names.index("robot")
