"""Parameters of running components: PARAM_SET, and the PARAM_VALUE that tells what has come of it.

A value travels in a float of four bytes. ArduPilot turns integers into floats; all others copy their bytes, as PX4
does. Source: https://mavlink.io/en/services/parameter.html
"""

from __future__ import annotations

import struct
import time
from contextlib import ExitStack, closing
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, PayloadError
from riot_bus_mavlink.frame import pack_frame, parse_frame

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from riot_bus.types.capabilities import ParameterRequest
    from riot_bus.types.port import PortPublisher
    from riot_bus.vocabulary.message import Scalar
    from riot_bus_mavlink.dialect import Dialect
    from riot_bus_mavlink.frame import Frame
    from riot_bus_mavlink.keys import KeyTemplate

ItemT = TypeVar("ItemT")

_READ = struct.Struct("<hBB16s")
"""PARAM_REQUEST_READ: index, -1 to ask by name, target system and component, name."""
_SET = struct.Struct("<4sBB16sB")
"""PARAM_SET: value, target system and component, name, type."""
_VALUE = struct.Struct("<4s4x16sB")
"""PARAM_VALUE: value, number of parameters and index, name, type."""
_ERROR = struct.Struct("<4x16sB")
"""PARAM_ERROR: target and index, name, error."""
_NAME = 16  # bytes of a name
_INTEGERS: Mapping[int, tuple[str, struct.Struct]] = {
    1: ("uint8", struct.Struct("<B3x")),
    2: ("int8", struct.Struct("<b3x")),
    3: ("uint16", struct.Struct("<H2x")),
    4: ("int16", struct.Struct("<h2x")),
    5: ("uint32", struct.Struct("<I")),
    6: ("int32", struct.Struct("<i")),
}
"""The integers of MAV_PARAM_TYPE that fit."""
_REAL = 9
"""MAV_PARAM_TYPE_REAL32."""
_FLOAT = struct.Struct("<f")
_SYSTEM, _COMPONENT, _LINK = 255, 25, "riot"
"""A ground station, since vehicles may obey no other system; a component id for users (MAV_COMP_ID_USER1)."""
_LOOK_S = 0.05  # how late the end of the system is noticed
_AGAIN_S = 0.5  # frames may get lost on links; vehicles answer within some milliseconds
_SURE = 2
"""Answers with another value that mean a refusal: the first one may be older than the question."""


class ParameterKind(NamedTuple):
    """How the values of a parameter travel.

    Attributes:
        type: Its MAV_PARAM_TYPE.
        cast: Whether integers are turned into floats; else their bytes are copied.
    """

    type: int
    cast: bool


def packed(value: Scalar, kind: ParameterKind, *, name: str) -> bytes:
    """Return the four bytes of a value.

    Raises:
        ConfigError: It is not a number, or the parameter's type is another one.
        PayloadError: It does not fit.
    """
    if isinstance(value, str | bytes):
        raise ConfigError(f"parameter {name} cannot be {value!r}", hint="values of MAVLink are numbers")
    if kind.type not in (*_INTEGERS, _REAL):
        raise ConfigError(f"parameter {name} is of type {kind.type}, whose values have no four bytes")
    called, form = _INTEGERS.get(kind.type, ("float32", _FLOAT))
    if kind.type != _REAL and isinstance(value, float):
        raise ConfigError(f"parameter {name} is an integer, not {value!r}", hint="write its values without a point")
    try:
        data = form.pack(value)
        return _FLOAT.pack(value) if kind.cast else data
    except (struct.error, OverflowError):
        raise PayloadError(f"it does not fit into {called}") from None


def unpacked(data: bytes, kind: ParameterKind) -> str:
    """Return the value that four bytes stand for, for people."""
    form = _FLOAT if kind.cast else _INTEGERS.get(kind.type, ("", _FLOAT))[1]
    (value,) = form.unpack(data)
    return f"{value:g}" if isinstance(value, float) else str(value)


def set_parameters(request: ParameterRequest, *, dialect: Dialect, keys: KeyTemplate) -> dict[str, str]:
    """Set parameters of a component one after the other, as `riot_bus.types.capabilities.SetsParameters` says."""
    for name in request.values:
        if not 0 < len(name.encode()) <= _NAME:
            raise ConfigError(f"{name!r} is not the name of a parameter", hint=f"it has up to {_NAME} characters")
    with ExitStack() as stack:
        exchange = _Exchange(request, dialect, keys, stack)
        told = {name: exchange.set(name, value) for name, value in request.values.items()}
    return {name: why for name, why in told.items() if why}


class _Exchange:
    """Frames to and from one component, over all ports."""

    def __init__(self, request: ParameterRequest, dialect: Dialect, keys: KeyTemplate, stack: ExitStack) -> None:
        self._request, self._dialect = request, dialect
        self._target = system, component = tuple(map(int, request.node.split("/")))
        self._deadline = time.monotonic() + request.timeout
        self._count = 0
        self._heard: SimpleQueue[bytes] = SimpleQueue()
        self._autopilot: int | None = None
        self._outlets: dict[str, list[PortPublisher]] = {"PARAM_REQUEST_READ": [], "PARAM_SET": []}
        for port in request.ports:
            for name in ("PARAM_VALUE", "PARAM_ERROR", "HEARTBEAT"):
                key = keys.expression("*", str(system), str(component), name)
                stack.enter_context(closing(port.subscribe(key, lambda payload, attachment: self._heard.put(payload))))
            for name, outlets in self._outlets.items():
                outlet = port.publisher(keys.key(_LINK, _SYSTEM, _COMPONENT, name), reliable=True)
                outlets.append(stack.enter_context(closing(outlet)))

    def set(self, name: str, value: Scalar) -> str:
        """Set one parameter; return why it is refused, empty if it is not, or the system has ended."""
        told, target = name.encode(), self._target
        kind = self._ask("PARAM_REQUEST_READ", _READ.pack(-1, *target, told), lambda frame: self._kind_of(frame, told))
        if kind is None:
            return self._ended(f"of what type {name} is", hint="is the parameter spelt right?")
        if kind in _INTEGERS and self._autopilot is None:
            self._ask("", b"", lambda frame: self._autopilot)
            if self._autopilot is None:
                return self._ended("by a HEARTBEAT in which form it takes integers")
        form = ParameterKind(kind, self._autopilot == 3)  # MAV_AUTOPILOT_ARDUPILOTMEGA
        try:
            data = packed(value, form, name=name)
        except PayloadError as error:
            return error.message
        others: list[bytes] = []

        def judged(frame: Frame) -> str | None:
            found = self._value_of(frame, told)
            if found is None:
                return self._error_of(frame, told)
            others.extend([found[0]] if found[0] != data else [])
            if found[0] == data:
                return ""
            return f"it answers {unpacked(found[0], form)}" if len(others) >= _SURE else None

        why = self._ask("PARAM_SET", _SET.pack(data, *target, told, kind), judged)
        return self._ended(f"what has come of {name}") if why is None else why

    def _ended(self, what: str, *, hint: str | None = None) -> str:
        """Raise the error of a component that runs and has not answered; else return nothing."""
        if self._request.alive():
            told = f"component {self._request.node} has not said within {self._request.timeout:g} s {what}"
            raise EnvironmentFaultError(told, hint=hint)
        return ""

    def _ask(self, name: str, payload: bytes, accept: Callable[[Frame], ItemT | None]) -> ItemT | None:
        """Send a message again and again until a frame is accepted; None if the time is over or the system ended."""
        sent = 0.0
        while (now := time.monotonic()) < self._deadline and self._request.alive():
            if name and now - sent >= _AGAIN_S:
                listening = [each for each in self._outlets[name] if each.matched()]
                for outlet in listening:
                    outlet.put(self._frame(name, payload), b"")
                sent = now if listening else sent
            try:
                frame = parse_frame(self._heard.get(timeout=_LOOK_S))
            except (Empty, PayloadError):
                continue
            if (frame.system, frame.component) != self._target:
                continue
            if self._dialect.name_of(frame.message_id) == "HEARTBEAT":
                self._autopilot = frame.payload.ljust(6, b"\0")[5]
            if (found := accept(frame)) is not None:
                return found
        return None

    def _frame(self, name: str, payload: bytes) -> bytes:
        message = self._dialect.message(name)
        assert message is not None, "`has_parameters` has checked this"
        self._count += 1
        return pack_frame(
            message.id,
            payload,
            message.crc_extra,
            version=2,
            sequence=self._count,
            system=_SYSTEM,
            component=_COMPONENT,
        )

    def _kind_of(self, frame: Frame, name: bytes) -> int | None:
        """Return the type of a parameter, None if the frame does not say it; raises ConfigError if there is none."""
        if why := self._error_of(frame, name):
            raise ConfigError(f"component {self._request.node} does not tell parameter {name.decode()}: {why}")
        found = self._value_of(frame, name)
        return None if found is None else found[1]

    def _value_of(self, frame: Frame, name: bytes) -> tuple[bytes, int] | None:
        """Return value and type of a parameter; None if the frame is of another message or parameter."""
        if self._dialect.name_of(frame.message_id) != "PARAM_VALUE":
            return None
        data, said, kind = _VALUE.unpack(frame.payload.ljust(_VALUE.size, b"\0")[: _VALUE.size])
        return (data, kind) if said.partition(b"\0")[0] == name else None

    def _error_of(self, frame: Frame, name: bytes) -> str | None:
        """Return the name of an error about a parameter; None if the frame says nothing of that."""
        if self._dialect.name_of(frame.message_id) != "PARAM_ERROR":
            return None
        said, number = _ERROR.unpack(frame.payload.ljust(_ERROR.size, b"\0")[: _ERROR.size])
        if said.partition(b"\0")[0] != name or not number:
            return None
        known = self._dialect.enums.get("MAV_PARAM_ERROR")
        entry = known.entries.get(number) if known is not None else None
        return entry.name.removeprefix("MAV_PARAM_ERROR_") if entry is not None else f"error {number}"
