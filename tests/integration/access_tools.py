"""A fleet's router with users, each of a role, and rules of access."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from riot_bus_fleet.agent.access import access_rules, question_limits
from tests.integration.zenoh_process import ZenohProcess

USERS = {"agent": "robot", "controller": "alice", "viewer": "viewer"}


def write_private(path: Path, text: str) -> None:
    """Write a file that its owner alone may read."""
    path.touch(0o600)
    path.write_text(text)


def login(role: str) -> dict[str, str]:
    return {"transport/auth/usrpwd/user": USERS[role], "transport/auth/usrpwd/password": role}


def options_of(role: str, folder: Path) -> list[str]:
    """Return the options of an agent that log it in, with its password in a file."""
    write_private(folder / f"{role}.password", role)
    given = {**login(role), "transport/auth/usrpwd/password": f"@{folder / f'{role}.password'}"}
    return [f"--fleet-cfg={key}={value}" for key, value in given.items()]


def secured(tmp_path: Path, rules: Mapping[str, Any]) -> ZenohProcess:
    users = tmp_path / "users.txt"
    write_private(users, "".join(f"{user}:{role}\n" for role, user in USERS.items()))
    return ZenohProcess(
        "router",
        transport__auth__usrpwd__dictionary_file=str(users),
        access_control=dict(rules),
        downsampling=question_limits(),
    )


def new_rules() -> dict[str, Any]:
    return access_rules((role, user) for role, user in USERS.items())  # type: ignore[misc]
