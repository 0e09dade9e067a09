"""Filters of links."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from riot_bus_bridges.mavlink.url import FILTER_NAMES, Filter, filter_of

SMALL = st.integers(0, 3)
LISTS = st.frozensets(SMALL, max_size=3)


@given(LISTS, LISTS, LISTS, LISTS, LISTS, LISTS, SMALL, SMALL, SMALL)
def test_what_passes(
    ids: frozenset[int],
    systems: frozenset[int],
    parts: frozenset[int],
    no_ids: frozenset[int],
    no_systems: frozenset[int],
    no_parts: frozenset[int],
    message_id: int,
    system: int,
    component: int,
) -> None:
    chosen = Filter(ids, systems, parts, no_ids, no_systems, no_parts)
    allowed = all(
        not allow or value in allow for allow, value in ((ids, message_id), (systems, system), (parts, component))
    )
    blocked = message_id in no_ids or system in no_systems or component in no_parts
    assert chosen.passes(message_id, system, component) == (allowed and not blocked)
    assert chosen.is_open == (not any((ids, systems, parts, no_ids, no_systems, no_parts)))


def test_settings_make_filters() -> None:
    assert filter_of({}, lambda name: None).is_open
    found = filter_of({"allow_msg_id_in": " 1, ATTITUDE,", "block_src_comp_in": "7"}, {"ATTITUDE": 30}.get)
    assert found == Filter(allow_msg_id=frozenset({1, 30}), block_src_comp=frozenset({7}))
    assert len(FILTER_NAMES["in"] | FILTER_NAMES["out"]) == 12
