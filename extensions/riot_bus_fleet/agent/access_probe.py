"""Test of who can do what at the keys of agents: sessions try it, which shows what happens, not what is configured."""

from __future__ import annotations

import threading
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import release
from riot_bus.zenoh.session_config import OWN_CHUNK
from riot_bus_fleet.agent.access import ROLES, Action, may
from riot_bus_fleet.agent.names import agent_token, controller_key, progress_key
from riot_bus_fleet.agent.proof import new_secret

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.zenoh import api as zenoh

NOBODY = "(nobody)"
"""The identity without a name: a session with no credentials at all."""

_COMMANDS = ("status", "logs", "play", "record", "pause", "resume", "seek", "rate", "stop")
_ASK_S = 1.0  # all sides are in this process and answer at once; silence means refusal


@dataclass(frozen=True, slots=True)
class Access:
    """An action at one key that was seen to succeed for one identity, which is a client with certain credentials.

    Attributes:
        seen_by: Identities on the other side, at least one: receivers of a `put`, publishers for `receive`, repliers
            for `ask`, askers for `answer`, those that found the token for `announce`, its holders for `see`.
        needed: Whether the role of this name (agent, controller or viewer) needs the action; False for `NOBODY`, None
            if the name is not that of a role.
    """

    identity: str
    action: Action
    key: str
    seen_by: tuple[str, ...]
    needed: bool | None


def probe_access(
    endpoint: str,
    identities: Mapping[str, Mapping[str, Any]],
    *,
    robot: str | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> list[Access]:
    """Let each identity try each action at each key of an agent, and return what the others saw of it.

    An action with two sides is seen only if both are allowed: while no identity can subscribe, no publication is seen.

    Args:
        identities: Zenoh configuration of each identity by name; one named after a role is compared with that role.
        robot: Name of the robot whose keys are tried; no such agent may be running. By default an unused name.

    Raises:
        EnvironmentFaultError: No identity can connect.
        ConfigError: An agent of this name is running and would carry out what is tried.
    """
    robot = robot or f"riot-doctor-{new_secret()[:8]}"
    with ExitStack() as stack:
        sides = []
        for name, config in {NOBODY: {}, **identities}.items():
            try:
                client = open_client(endpoint, config=dict(config))
            except EnvironmentFaultError as error:
                say(f"{name} cannot connect: {error.message}")
                continue
            stack.callback(client.close)
            sides.append(_Side(name, client.session))
        if not sides:
            raise EnvironmentFaultError("no identity can connect", where=endpoint, hint="is the router running?")
        if any(side.sees(agent_token(robot, "*")) for side in sides):
            hint = "stop it first, or leave --robot out"
            raise ConfigError(f"the agent {robot!r} is running, and would do what is tried", where="--robot", hint=hint)
        keys = [f"{OWN_CHUNK}/{robot}/agent/{name}" for name in _COMMANDS]
        keys += [progress_key(robot), controller_key(robot, "0" * 16)]
        found: set[tuple[str, Action, str, str]] = set()
        for side in sides:
            stack.callback(side.close)
            side.offer([*keys, agent_token(robot, "0" * 32)])
        end = time.monotonic() + 3.0
        while time.monotonic() < end:  # declarations take time, and nothing tells when they have arrived
            for side in sides:
                side.put(keys)
            time.sleep(0.2)  # the first tries may come before the declarations
        for side in sides:
            for key, other in side.ask(keys):
                found |= {(side.name, "ask", key, other), (other, "answer", key, side.name)}
            for key, other in side.received():
                found |= {(side.name, "receive", key, other), (other, "put", key, side.name)}
            token = agent_token(robot, "0" * 32)
            for holder in sides:
                if holder is not side and side.sees(f"{token}{holder.mark}"):
                    found |= {(side.name, "see", token, holder.name), (holder.name, "announce", token, side.name)}
    others: dict[tuple[str, Action, str], list[str]] = {}
    for name, action, key, other in sorted(found):
        others.setdefault((name, action, key), []).append(other)
    return [
        Access(name, action, key, tuple(seen_by), _needed(name, action, key, robot))
        for (name, action, key), seen_by in others.items()
    ]


def _needed(name: str, action: Action, key: str, robot: str) -> bool | None:
    if name == NOBODY:
        return False
    return next((may(role, action, key, robot=robot) for role in ROLES if role == name), None)


class _Side:
    """One identity's session, and what it has seen of the others."""

    def __init__(self, name: str, session: zenoh.Session) -> None:
        self.name = name
        self.mark = new_secret()[:8]
        self._session = session
        self._lock = threading.Lock()
        self._received: set[tuple[str, str]] = set()
        self._things: list[Any] = []

    def offer(self, keys: Sequence[str]) -> None:
        """Subscribe to all keys but the last, answer at them, and hold a token at the last one."""
        *keys, token = keys
        for key in keys:
            self._things.append(self._session.declare_subscriber(key, self._take))
            self._things.append(self._session.declare_queryable(key, self._answer))
        self._things.append(self._session.liveliness().declare_token(f"{token}{self.mark}"))

    def put(self, keys: Sequence[str]) -> None:
        for key in keys:
            self._session.put(key, self.name.encode())

    def ask(self, keys: Sequence[str]) -> set[tuple[str, str]]:
        """Return pairs of a key and another identity that answers there."""
        from riot_bus.zenoh import api as zenoh

        every, each = zenoh.QueryTarget.ALL, zenoh.ConsolidationMode.NONE
        asked = {key: self._session.get(key, timeout=_ASK_S, target=every, consolidation=each) for key in keys}
        answers = ((key, reply.ok) for key, replies in asked.items() for reply in replies)
        found = {(key, ok.payload.to_bytes().decode(errors="replace")) for key, ok in answers if ok is not None}
        return {(key, other) for key, other in found if other != self.name}

    def sees(self, token: str) -> bool:
        return any(reply.ok is not None for reply in self._session.liveliness().get(token, timeout=_ASK_S))

    def received(self) -> set[tuple[str, str]]:
        """Return pairs of a key and another identity that published there."""
        with self._lock:
            return {(key, other) for key, other in self._received if other != self.name}

    def close(self) -> None:
        from riot_bus.zenoh import api as zenoh

        with suppress(zenoh.ZError):
            release(*self._things)

    def _take(self, sample: zenoh.Sample) -> None:
        with self._lock:
            self._received.add((str(sample.key_expr), sample.payload.to_bytes().decode(errors="replace")))

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, self.name)
