"""Rules of access for a fleet's router: what each role needs, and nothing else (Zenoh's access control)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, get_args

from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.vocabulary.selector import key_matches
from riot_bus.zenoh.session_config import OWN_CHUNK
from riot_bus_fleet.agent.names import agent_token, controller_key, progress_key

Role = Literal["agent", "controller", "viewer"]
"""Agents carry out commands, controllers give them, and viewers only watch."""

ROLES: tuple[Role, ...] = get_args(Role)

Action = Literal["put", "receive", "ask", "answer", "announce", "see"]
"""In this order: publish, subscribe, query, reply, hold a liveliness token, look for one."""

ACTIONS: dict[Action, tuple[str, str]] = {
    "put": ("ingress", "put"),
    "receive": ("ingress", "declare_subscriber"),
    "ask": ("ingress", "query"),
    "answer": ("ingress", "reply"),
    "announce": ("ingress", "liveliness_token"),
    "see": ("ingress", "liveliness_query"),
}
"""Flow of each action, as the router sees it, and its name in Zenoh's access control."""

_READING = ("status", "logs")

_ASK, _ANSWER = ("ingress", "query"), ("egress", "query")
_REPLY, _GET_REPLY = ("ingress", "reply"), ("egress", "reply")


def parse_subject(text: str) -> tuple[Role, str]:
    """Parse `ROLE` or `ROLE=USER`, a role alone being its own user; raises ConfigError if the role does not exist."""
    word, _, user = text.partition("=")
    for role in ROLES:
        if word == role:
            return role, user or role
    raise ConfigError(f"no role {word!r}", hint=did_you_mean(word, ROLES) or f"there are {', '.join(ROLES)}")


def access_rules(
    subjects: Iterable[tuple[Role, str]], *, robot: str = "*", certificates: bool = False
) -> dict[str, Any]:
    """Return Zenoh's `access_control` for a fleet's router, which denies all that no rule allows.

    Args:
        robot: Name of the robot whose agent may be commanded and may answer; `*` for any.
    """
    users: dict[Role, list[str]] = {}
    for role, user in subjects:
        users.setdefault(role, []).append(user)
    rules, policies = [], []
    for role in users:
        own = [
            {
                "id": f"{role}-{flow}-{message}",
                "permission": "allow",
                "flows": [flow],
                "messages": [message],
                "key_exprs": keys,
            }
            for (flow, message), keys in _needs(role, robot).items()
        ]
        rules += own
        policies.append({"rules": [each["id"] for each in own], "subjects": [role]})
    told_by = "cert_common_names" if certificates else "usernames"
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": role, told_by: names} for role, names in users.items()],
        "policies": policies,
    }


def question_limits() -> list[dict[str, Any]]:
    """Return Zenoh's `downsampling` for a fleet's router, which limits how often one link may query logs.

    A query within a 20th of a second after another one is dropped, so commands must not be limited this way.
    """
    rules = [{"key_expr": f"{OWN_CHUNK}/*/agent/logs", "freq": 20.0}]
    return [{"id": "questions", "messages": ["query"], "flows": ["ingress"], "rules": rules}]


def may(role: Role, action: Action, key: str, *, robot: str = "*") -> bool:
    """Return whether a role needs to do something at a key, so that its rules allow it."""
    return any(key_matches(each, key) for each in _needs(role, robot).get(ACTIONS[action], ()))


def _needs(role: Role, robot: str) -> Mapping[tuple[str, str], Sequence[str]]:
    """Return the key expressions that a role needs, by flow (seen from the router) and kind of message."""
    commands, presence = f"{OWN_CHUNK}/{robot}/agent/**", controller_key(robot, "*")
    tokens, progress = agent_token(robot, "*"), progress_key(robot)
    if role == "agent":
        return {
            ("ingress", "declare_queryable"): [commands],
            _ANSWER: [commands],
            _REPLY: [commands],
            ("ingress", "put"): [progress],
            ("ingress", "liveliness_token"): [tokens],
            ("ingress", "liveliness_query"): [tokens],
            ("egress", "liveliness_token"): [tokens],
            _ASK: [presence],
            _GET_REPLY: [presence],
        }
    looking = {
        ("ingress", "liveliness_query"): [tokens],
        ("egress", "liveliness_token"): [tokens],
        ("ingress", "declare_subscriber"): [progress],
        ("egress", "put"): [progress],
    }
    if role == "viewer":
        reading = [f"{OWN_CHUNK}/{robot}/agent/{name}" for name in _READING]
        return {**looking, _ASK: reading, _GET_REPLY: reading}
    return {
        **looking,
        _ASK: [f"{OWN_CHUNK}/{robot}/agent/*"],
        _GET_REPLY: [f"{OWN_CHUNK}/{robot}/agent/*"],
        ("ingress", "declare_queryable"): [presence],
        _ANSWER: [presence],
        _REPLY: [presence],
    }
