"""Packets of a UDP socket, many with one call: fetching them one by one takes longer than handling them."""

from __future__ import annotations

import ctypes
import errno
import functools
import mmap
import socket
import struct
from typing import Any

_AT_ONCE = 64  # packets per call; their buffers take 4 MiB of address space for each socket
_LARGEST = 1 << 16  # UDP has 16 bits for the length of a packet
_NAME = 32  # bytes, more than addresses of IPv4 and IPv6 have
_IPV4 = struct.Struct("!2xH4s")
_IPV6 = struct.Struct("!2xHI16s")
_FAMILY, _SCOPE = struct.Struct("=H"), struct.Struct("=24xI")
_NONE_THERE = {errno.EAGAIN, errno.EWOULDBLOCK}
_REFUSED = {errno.ENOSYS, errno.EPERM}  # as old systems and sandboxes do


class _Vector(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("size", ctypes.c_size_t))


class _Message(ctypes.Structure):
    """As `struct msghdr` in recvmsg(2)."""

    _fields_ = (
        ("name", ctypes.c_void_p),
        ("name_size", ctypes.c_uint),
        ("vectors", ctypes.c_void_p),
        ("vector_count", ctypes.c_size_t),
        ("control", ctypes.c_void_p),
        ("control_size", ctypes.c_size_t),
        ("flags", ctypes.c_int),
    )


class _Slot(ctypes.Structure):
    """As `struct mmsghdr` in recvmmsg(2)."""

    _fields_ = (("message", _Message), ("size", ctypes.c_uint))


class Packets:
    """Fetches packets; for use on one thread.

    Args:
        made: The socket, non-blocking and owned by the caller.
    """

    def __init__(self, made: socket.socket) -> None:
        self._socket = made
        self._receive = _recvmmsg()
        self._data = mmap.mmap(-1, _AT_ONCE * _LARGEST)  # only pages that were used take memory
        self._names = bytearray(_AT_ONCE * _NAME)
        data = ctypes.addressof(ctypes.c_char.from_buffer(self._data))
        names = ctypes.addressof(ctypes.c_char.from_buffer(self._names))
        places = range(0, _AT_ONCE * _LARGEST, _LARGEST)
        self._vectors = (_Vector * _AT_ONCE)(*(_Vector(data + place, _LARGEST) for place in places))
        vectors, step = ctypes.addressof(self._vectors), ctypes.sizeof(_Vector)
        messages = [_Message(names + at * _NAME, _NAME, vectors + at * step, 1) for at in range(_AT_ONCE)]
        self._slots = (_Slot * _AT_ONCE)(*map(_Slot, messages))
        words = memoryview(self._slots).cast("B").cast("I")
        self._sizes = words[_Slot.size.offset // words.itemsize :: ctypes.sizeof(_Slot) // words.itemsize]
        self._places = places

    def receive(self) -> list[tuple[Any, list[bytes]]]:
        """Return packets in order of arrival: senders' addresses, each with its consecutive packets.

        The list is empty if nothing has arrived, and not complete if much has.
        """
        if self._receive is None:
            return self._one_by_one()
        count = -1
        for _ in range(_AT_ONCE):
            count = self._receive(self._socket.fileno(), self._slots, _AT_ONCE, socket.MSG_DONTWAIT, None)
            if count >= 0 or (error := ctypes.get_errno()) in _NONE_THERE:
                break
            if error in _REFUSED:
                self._receive = None
                return self._one_by_one()
            # Any other error reports that an earlier packet found no receiver.
        if count <= 0:
            return []
        data = self._data
        packets = [data[at : at + size] for at, size in zip(self._places, self._sizes[:count].tolist(), strict=False)]
        names = bytes(self._names[: count * _NAME])
        first = names[:_NAME]
        if names == first * count:
            return [(_address(first), packets)]
        return _in_runs([(_address(names[at * _NAME : (at + 1) * _NAME]), each) for at, each in enumerate(packets)])

    def _one_by_one(self) -> list[tuple[Any, list[bytes]]]:
        found = []
        for _ in range(_AT_ONCE):
            try:
                data, address = self._socket.recvfrom(_LARGEST)
            except BlockingIOError:
                break
            except OSError:  # an earlier packet found no receiver
                continue
            found.append((address, data))
        return _in_runs(found)


def _in_runs(found: list[tuple[Any, bytes]]) -> list[tuple[Any, list[bytes]]]:
    runs: list[tuple[Any, list[bytes]]] = []
    for address, data in found:
        if not runs or runs[-1][0] != address:
            runs.append((address, []))
        runs[-1][1].append(data)
    return runs


@functools.lru_cache(maxsize=256)
def _address(name: bytes) -> Any:
    """Return the system's form of an address in the form of `socket`."""
    if _FAMILY.unpack_from(name)[0] == socket.AF_INET:
        port, host = _IPV4.unpack_from(name)
        return socket.inet_ntop(socket.AF_INET, host), port
    port, flow, host = _IPV6.unpack_from(name)
    return socket.inet_ntop(socket.AF_INET6, host), port, flow, *_SCOPE.unpack_from(name)


@functools.cache
def _recvmmsg() -> Any:
    """Return the system's `recvmmsg`, None if it has none."""
    try:
        function = ctypes.CDLL(None, use_errno=True).recvmmsg
    except (OSError, AttributeError):
        return None
    function.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p)
    return function
