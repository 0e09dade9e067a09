"""Parameters of running nodes: the service `<node>/set_parameters`, which every node of ROS 2 has.

Source: `SetParameters` and `ParameterValue` of rcl_interfaces.
"""

from __future__ import annotations

import time
from contextlib import ExitStack, closing
from functools import partial
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, TypeVar

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, PayloadError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.types.capabilities import Announcement, ParameterRequest
    from riot_bus.types.port import SegmentAccess
    from riot_bus.vocabulary.message import Scalar
    from riot_bus_ros2.store import TypeStore

ItemT = TypeVar("ItemT")

_SERVICE = "rcl_interfaces/srv/SetParameters"
_ENDING = "/set_parameters"
_KINDS: Mapping[type, tuple[int, str]] = {
    bool: (1, "bool_value"),
    int: (2, "integer_value"),
    float: (3, "double_value"),
    str: (4, "string_value"),
}
"""Constants of `ParameterType`, and the field of `ParameterValue` that has the value."""
_LOOK_S = 0.05  # how late the end of the system is noticed, and how soon a server without an answer is asked again


def request_of(values: Mapping[str, Scalar], store: TypeStore) -> bytes:
    """Return the payload of a request that sets parameters; raise ConfigError for a value of another type."""
    from riot_bus_ros2.cdr import CdrType

    changes: dict[str, Scalar] = {"len(parameters)": len(values)}
    for number, (name, value) in enumerate(values.items()):
        if type(value) not in _KINDS:
            raise ConfigError(f"parameter {name!r} cannot be {value!r}", hint="a boolean, a number or a text")
        kind, field = _KINDS[type(value)]
        place = f"parameters[{number}]"
        changes |= {f"{place}.name": name, f"{place}.value.type": kind, f"{place}.value.{field}": value}
    return CdrType(f"{_SERVICE}_Request", store).rebuild(b"\0\1\0\0" + bytes(4), changes)  # from none at all


def refused_by(reply: bytes, names: Sequence[str], store: TypeStore) -> dict[str, str]:
    """Return the parameters that a reply refuses, each with the node's reason.

    Args:
        names: Names of the parameters, in the order of the request.

    Raises:
        PayloadError: It is not a reply to a request for these.
    """
    results = store.decode(reply, f"{_SERVICE}_Response").results
    if len(results) != len(names):
        raise PayloadError(f"{len(results)} results for {len(names)} parameters")
    told = zip(names, results, strict=True)
    return {name: str(one.reason) or "it gives no reason" for name, one in told if not one.successful}


def set_parameters(
    request: ParameterRequest,
    *,
    store: TypeStore,
    tokens: str,
    announcement: Callable[[str], Announcement | None],
    attachment: Callable[[], bytes],
) -> dict[str, str]:
    """Set parameters of a node, as `riot_bus.types.capabilities.SetsParameters` says."""
    node, timeout, alive = request.node, request.timeout, request.alive
    payload, deadline = request_of(request.values, store), time.monotonic() + timeout
    found: SimpleQueue[tuple[SegmentAccess, str]] = SimpleQueue()
    others: set[str] = set()

    def hear(port: SegmentAccess, token: str, there: bool) -> None:  # noqa: FBT001
        one = announcement(token) if there else None
        if one is not None and (one.role, one.type_name) == ("serves", _SERVICE):
            others.add(one.topic.removesuffix(_ENDING))
            if one.topic == node + _ENDING:
                found.put((port, one.key))

    with ExitStack() as stack:
        for port in request.ports:
            stack.enter_context(closing(port.watch(tokens, partial(hear, port))))
        service = _next(found, deadline, alive)
    if service is None and alive():
        told = f"node {node!r} has not announced its service {_ENDING[1:]!r} within {timeout:g} s"
        raise EnvironmentFaultError(told, hint=did_you_mean(node, others))
    while service is not None and time.monotonic() < deadline and alive():
        replies: SimpleQueue[bytes | None] = SimpleQueue()
        with closing(service[0].ask(service[1], payload, attachment(), replies.put, complete=False)):
            reply = _next(replies, deadline, alive)
        if reply is not None:
            try:
                return refused_by(reply, list(request.values), store)
            except PayloadError as error:
                raise EnvironmentFaultError(f"the answer of node {node!r} cannot be read: {error}") from None
        _next(replies, min(deadline, time.monotonic() + _LOOK_S), alive)  # it is announced before it can be asked
    if alive():
        raise EnvironmentFaultError(f"node {node!r} has not said within {timeout:g} s that its parameters are set")
    return {}


def _next(items: SimpleQueue[ItemT], deadline: float, alive: Callable[[], bool]) -> ItemT | None:
    """Wait for the next item; return None if the time is over, or the system has ended."""
    while (left := deadline - time.monotonic()) > 0 and alive():
        try:
            return items.get(timeout=min(left, _LOOK_S))
        except Empty:
            continue
    return None
