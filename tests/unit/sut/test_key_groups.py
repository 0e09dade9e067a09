from __future__ import annotations

import pytest

from riot_bus.sut.key_groups import grouped

UUIDS = [f"{number:08x}-0000-4000-8000-000000000000" for number in range(2)]


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        (["r/1/p", "r/2/p"], {"r/*/p"}),
        (["r/1/p", "r/20/p", "r/1/q", "r/20/q"], {"r/*/p", "r/*/q"}),
        ([f"r/{each}" for each in UUIDS], {"r/*"}),
        (["r/1/p"], {"r/1/p"}),  # one is no group
        (["r/a/p", "r/b/p"], {"r/a/p", "r/b/p"}),  # names are not numbers
        (["r1/p", "r2/p"], {"r1/p", "r2/p"}),  # a number within a chunk is a name
        (["r/1/2", "r/1/3", "r/2/2"], {"r/1/2", "r/1/3", "r/2/2"}),  # by which of two numbers?
        ([f"r/{a}/{b}" for a in (1, 2) for b in (1, 2, 3)], {"r/1/*", "r/2/*"}),
        (["r/1/p", "r/2/p", "r/x/p"], {"r/1/p", "r/2/p", "r/x/p"}),  # the expression would include another key
    ],
)
def test_keys_that_differ_by_a_number_or_id(keys: list[str], expected: set[str]) -> None:
    found = grouped(dict.fromkeys(keys, "json"))
    assert found.keys() == expected
    assert sorted(key for members in found.values() for key in members) == sorted(keys)


def test_what_is_not_alike_stays_apart() -> None:
    assert grouped({"r/1/p": "json", "r/2/p": "raw"}).keys() == {"r/1/p", "r/2/p"}
    assert grouped({"r/1/p": 0, "r/2/p": 0}, ["r/3/p"]).keys() == {"r/1/p", "r/2/p"}
    assert grouped({}) == {}
