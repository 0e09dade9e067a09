"""Opening of Zenoh sessions: their threads, ports, and understandable errors."""

from __future__ import annotations

import atexit
import json
import os
import re
import threading
import time
import warnings
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, install_hint
from riot_bus.vocabulary.selector import check_wildcards

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import zenoh

    from riot_bus.zenoh.session_config import SessionConfig

_VARIABLE = "ZENOH_RUNTIME"
_RECEIVERS = 128  # as many components may block one each (`prepare_runtime`); waiting threads cost little


def _runtime(receivers: int) -> str:
    return f"(rx: (worker_threads: {receivers}), tx: (worker_threads: 4))"


_OURS = {_runtime(_RECEIVERS)}
"""Values set by `prepare_runtime`, in this process or in the riot process that started it."""
_FEW_RECEIVERS = 4  # with fewer, three components that flood slow ones block all; a guess
_CALLBACKS = "pyo3-closure"
_CALLBACKS_S = 3.0  # callbacks end soon after their sessions; a hung one delays the end by this; a guess
_SOURCE = re.compile(r"\s+at /\S+\.rs:\d+\.?")


def prepare_runtime(receivers: int = _RECEIVERS) -> None:
    """Give Zenoh's runtimes enough receive threads; call before the first session of the process.

    A receive task that pushes into a full queue blocks its thread, so each component that publishes faster than its
    subscribers receive may block a thread of a router. If none is left for the link to the subscribers, and they
    publish as fast in the other direction, both routers wait until Zenoh closes links. Waiting threads cost little.
    """
    if _VARIABLE not in os.environ:
        os.environ[_VARIABLE] = _runtime(receivers)
        _OURS.add(os.environ[_VARIABLE])
    if os.environ[_VARIABLE] in _OURS:
        return
    receivers = _receivers_of(os.environ[_VARIABLE])
    if receivers < _FEW_RECEIVERS:
        hint = f"set {_VARIABLE}='{_runtime(_RECEIVERS)}'"
        text = f"receive threads per router: {receivers}: expect stalls and closed links under load; {hint}"
        warnings.warn(text, RuntimeWarning, stacklevel=2)


def environment_of_others() -> dict[str, str]:
    """Return the environment for processes of others, without the setting of `prepare_runtime` for routers."""
    return {name: value for name, value in os.environ.items() if name != _VARIABLE or value not in _OURS}


@atexit.register
def _end_callbacks() -> None:
    """Wait for the threads on which Zenoh calls back, which end after their sessions.

    Python does so itself, except for those declared by a daemon thread, which are daemons, too. If one of these needs
    the interpreter during shutdown, the whole process aborts (Rust cannot be unwound by `pthread_exit`).
    """
    deadline = time.monotonic() + _CALLBACKS_S
    for thread in threading.enumerate():
        if thread.daemon and _CALLBACKS in thread.name:
            thread.join(max(0.0, deadline - time.monotonic()))


def _receivers_of(value: str) -> int:
    found = re.search(r"\brx\s*:\s*\([^()]*?worker_threads\s*:\s*(\d+)", value)
    return int(found.group(1)) if found else 2  # Zenoh's default


def free_endpoint() -> str:
    """Return a TCP endpoint that is free now; prefer listening on port 0, which cannot be taken in between."""
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def open_session(config: SessionConfig, *, purpose: str, library: Any = None) -> zenoh.Session:
    """Open a Zenoh session.

    Args:
        config: Configuration keys and JSON values.
        purpose: Purpose of the session for errors, such as `segment 'unit'`.
        library: Copy of Zenoh's library (`libraries.borrow`); None for `zenoh` itself.

    Raises:
        ConfigError: Zenoh does not know a key or rejects its value.
        EnvironmentFaultError: A port is in use, or there is no answer from an endpoint.
    """
    import zenoh

    library = library or zenoh
    library.try_init_log_from_env()  # RUST_LOG
    settings = library.Config()
    for key, value in config.items():
        try:
            settings.insert_json5(key, json.dumps(value))
        except library.ZError as error:
            raise ConfigError(
                f"Zenoh refuses {json.dumps(value)}: {reason(error)}",
                where=f"{purpose}: {key}",
                hint="keys are those of Zenoh's configuration file, joined by '/'",
            ) from error
    try:
        session: zenoh.Session = library.open(settings)
    except library.ZError as error:
        raise _open_error(error, config, purpose) from error
    return session


def _open_error(error: Exception, config: SessionConfig, purpose: str) -> EnvironmentFaultError:
    text = reason(error)
    listen = ", ".join(config.get("listen/endpoints", ()))
    connect = ", ".join(config.get("connect/endpoints", ()))
    if "in use" in text:
        found = re.search(r"\w+/\S+:\d+(?=: )", text)
        hint = f"stop what listens there, or choose another endpoint, such as --segment NAME={free_endpoint()}"
        return EnvironmentFaultError(f"{found.group() if found else listen} is in use", where=purpose, hint=hint)
    if "connect" in text.lower() and connect:
        from riot_bus.zenoh.tls import why_refused  # loads ssl

        why = next(filter(None, (why_refused(each, config) for each in config["connect/endpoints"])), None)
        if why is not None:
            hint = "compare certificates and names on both sides (docs/router.md)"
            return EnvironmentFaultError(f"no link to {connect}: {why}", where=purpose, hint=hint)
        return EnvironmentFaultError(f"nobody answers at {connect}", where=purpose, hint="is the router running?")
    return EnvironmentFaultError(f"Zenoh does not open {listen or connect}: {text}", where=purpose)


def reason(error: Exception) -> str:
    """Return Zenoh's message without the places in its source code."""
    return _SOURCE.sub("", str(error)).strip()


def listening(session: zenoh.Session) -> list[str]:
    """Return the actual endpoints of a router session: port 0 is replaced by the assigned port."""
    for reply in session.get(f"@/{session.info.zid()}/router", timeout=5.0):
        if reply.ok is not None:
            return [str(locator) for locator in json.loads(reply.ok.payload.to_bytes())["locators"]]
    return []


def release(*things: Any) -> None:
    """Close sessions and undeclare everything else; Zenoh's stubs leave these methods untyped."""
    for thing in things:
        getattr(thing, "close" if hasattr(thing, "close") else "undeclare")()


def canonical(expressions: Sequence[str]) -> list[str]:
    """Return key expressions in Zenoh's canonical form.

    Raises:
        ConfigError: One is not a key expression, or has too many wildcards.
    """
    import zenoh

    result = []
    for text in expressions:
        try:
            result.append(str(zenoh.KeyExpr.autocanonize(text)))
        except zenoh.ZError as error:
            hint = "write chunks joined by '/', with * for one chunk and ** for any number, such as 'robot/*/odom'"
            if text.startswith("/"):
                hint += f"; for names of ROS 2 topics: {install_hint('ros2')}"
            raise ConfigError(f"{text!r} is not a key expression: {reason(error)}", hint=hint) from error
        check_wildcards(result[-1])
    return list(dict.fromkeys(result))


def includes(expression: str, other: str) -> bool:
    """Return whether a canonical key expression matches all keys that another one matches."""
    import zenoh

    return bool(zenoh.KeyExpr(expression).includes(other))


def intersects(expression: str, other: str) -> bool:
    """Return whether there can be a key that two canonical key expressions match."""
    import zenoh

    return bool(zenoh.KeyExpr(expression).intersects(other))


def wait_until(condition: Callable[[], bool], timeout: float, *, interval: float = 0.001) -> bool:
    """Wait until a condition holds; return whether it did before the deadline."""
    deadline = time.monotonic() + timeout
    while not condition():
        if time.monotonic() >= deadline:
            return False
        time.sleep(interval)
    return True
