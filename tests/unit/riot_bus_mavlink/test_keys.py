from __future__ import annotations

import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_mavlink.keys import TEMPLATE, KeyTemplate, Parsed


@pytest.mark.parametrize(
    ("template", "key", "parsed"),
    [
        (TEMPLATE, "mavlink_raw/udp/1/200/HEARTBEAT", Parsed("udp", 1, 200, "HEARTBEAT")),
        ("{MESSAGE}/of/{sysid}", "HEARTBEAT/of/1", Parsed("", 1, None, "HEARTBEAT")),
        ("my.own/{MESSAGE}", "my.own/HEARTBEAT", Parsed("", None, None, "HEARTBEAT")),
    ],
)
def test_a_key_has_all_that_its_template_has(template: str, key: str, parsed: Parsed) -> None:
    keys = KeyTemplate(template)
    assert keys.key("udp", 1, 200, "HEARTBEAT") == key
    assert keys.parse(key) == parsed


def test_wildcards_stand_for_what_is_not_given() -> None:
    assert KeyTemplate().expression() == "mavlink_raw/*/*/*/*"
    assert KeyTemplate().expression(system="1", message="HEARTBEAT") == "mavlink_raw/*/1/*/HEARTBEAT"


@pytest.mark.parametrize(
    "key",
    [
        "mavlink_raw/udp/1/2",
        "mavlink_raw/udp/1/2/HEARTBEAT/x",
        "x/mavlink_raw/udp/1/2/HEARTBEAT",
        "mavlink_raw/udp/256/2/HEARTBEAT",
        "mavlink_raw/udp/1/999/HEARTBEAT",
        "mavlink_raw/udp/1/x/HEARTBEAT",
        "mavlink_raw/udp/1/2/3D",
        "mavlink_raw//1/2/HEARTBEAT",
        "mavlink_raw/*/1/2/HEARTBEAT",
        "mavlink_raw/udp/1/2/HEARTBEAT\n",
    ],
)
def test_keys_of_others(key: str) -> None:
    assert KeyTemplate().parse(key) is None


def test_a_literal_is_taken_literally() -> None:
    assert KeyTemplate("a.b/{MESSAGE}").parse("axb/HEARTBEAT") is None


@pytest.mark.parametrize(
    "template",
    ["{MESSAGE}", "a/{link}", "{MESSAGE}/{link}", "a/{MESSAGE}/{MESSAGE}", "a/{message}/{MESSAGE}", "a/*/{MESSAGE}",
     "a//{MESSAGE}", "a/x{link}/{MESSAGE}", "/a/{MESSAGE}", ""],
)  # fmt: skip
def test_templates_that_cannot_work(template: str) -> None:
    with pytest.raises(ConfigError, match="template of keys"):
        KeyTemplate(template)
