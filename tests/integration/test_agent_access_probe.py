"""`riot doctor --acl`: what each identity is seen to do, with the rules of today, of before, and with none."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_fleet.agent.access_probe import NOBODY, probe_access
from tests.integration.access_tools import USERS, login, new_rules, secured
from tests.integration.agent_tools import agent
from tests.integration.zenoh_process import ZenohProcess

pytestmark = pytest.mark.integration

OLD_RULES = {
    "enabled": True,
    "default_permission": "allow",
    "rules": [
        {
            "id": "look",
            "permission": "deny",
            "flows": ["ingress"],
            "messages": ["query"],
            "key_exprs": [
                f"@riot/*/agent/{name}" for name in ("play", "record", "pause", "resume", "stop", "seek", "rate")
            ],
        }
    ],
    "subjects": [{"id": "viewer", "usernames": ["viewer"]}],
    "policies": [{"rules": ["look"], "subjects": ["viewer"]}],
}
"""What the documentation recommended once: it denies questions alone."""


@pytest.mark.parametrize("rules", ["new", "old", "none"])
def test_the_doctor_sees_who_can_do_what(tmp_path: Path, rules: str) -> None:
    table = {"new": new_rules(), "old": OLD_RULES, "none": {"enabled": False, "default_permission": "allow"}}[rules]
    with secured(tmp_path, table) as router:
        said: list[str] = []
        found = probe_access(router.locators[0], {role: login(role) for role in USERS}, say=said.append)
        excess = {(each.identity, each.action, each.key.rpartition("agent/")[2]) for each in found if not each.needed}
        assert [each.partition(" ")[0] for each in said] == [NOBODY]
        does = {(each.identity, each.action, each.key.rpartition("agent/")[2]) for each in found}
        assert {("agent", "answer", "stop"), ("controller", "ask", "stop"), ("viewer", "ask", "status")} <= does
        assert {("viewer", "receive", "progress"), ("agent", "put", "progress")} <= does
        if rules == "new":
            assert excess == set()
        else:
            assert ("viewer", "answer", "stop") in excess, "it could play the robot"
            assert ("viewer", "put", "progress") in excess
            assert ("viewer", "announce", "0" * 32) in excess
            assert (("viewer", "ask", "stop") in excess) == (rules == "none")


def test_the_doctor_does_not_command_a_robot(tmp_path: Path) -> None:
    with (
        ZenohProcess("router") as router,
        agent(tmp_path, router.locators[0], router.locators[0]),
        pytest.raises(ConfigError, match="'r7' is running"),
    ):
        probe_access(router.locators[0], {}, robot="r7")
