"""Names of the order of two messages."""

from __future__ import annotations

import pytest

from riot_bus.vocabulary.order import Order, order_of


@pytest.mark.parametrize("order", [Order("/arm", "/config"), Order("a/b", "c", once=True)])
def test_an_order_is_its_name(order: Order) -> None:
    assert order_of(str(order)) == order


def test_what_is_said() -> None:
    assert str(Order("/arm", "/config")) == "/arm before /config"
    assert str(Order("/arm", "/config", once=True)) == "/arm before the first /config"


@pytest.mark.parametrize("name", ["/odom:x", 'a:["x before y"]', "a[0] before b", "before", "a before "])
def test_what_is_none(name: str) -> None:
    assert order_of(name) is None
