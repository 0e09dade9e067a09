"""What `riot bridge mavlink` is asked to do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_bridges.mavlink.options import MavlinkBridgeOptions

LINK = ["udpin:1"]


@pytest.mark.parametrize(
    ("options", "part"),
    [
        ({"links": []}, "--link udpin:0.0.0.0:14550"),
        ({"links": ["udpinn:1"]}, "did you mean 'udpin'"),
        ({"links": LINK, "dialect": "comon"}, "common"),
        ({"links": LINK, "keys": "a/{x}"}, "{x}"),
        ({"links": LINK, "sniffer": 256}, "256"),
        ({"links": LINK, "duplicates": 90.0}, "not a usable period"),
        ({"links": LINK, "duplicates": float("nan")}, "not a usable period"),
        ({"links": LINK, "key_file": Path("/no/such/file")}, "/no/such/file"),
        ({"links": ["c=udpin:1"]}, "no segment 'c'"),
        ({"links": ["a=udpin:1?block_msg_id_in=NOBODY"]}, "not known"),
    ],
)
def test_what_is_wrong_is_named(options: dict[str, Any], part: str) -> None:
    with pytest.raises(ConfigError) as error:
        MavlinkBridgeOptions(**options).plan(["a"])
    assert part in str(error.value)


def test_a_plan() -> None:
    plan = MavlinkBridgeOptions(["a/x=udpin:1?block_msg_id_in=HEARTBEAT"], dialect="common").plan(["a", "b"])
    (link,) = plan.links
    assert (link.segment, link.name, link.accepts.block_msg_id) == ("a", "x", frozenset({0}))
    assert plan.keys.key("x", 1, 2, "HEARTBEAT") == "mavlink_raw/x/1/2/HEARTBEAT"
    assert plan.signer is None
    with pytest.raises(ConfigError, match="to which segment"):
        MavlinkBridgeOptions(LINK).plan(["a", "b"])
