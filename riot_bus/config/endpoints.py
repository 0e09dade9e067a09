"""Zenoh endpoints, `<protocol>/<address>[?<metadata>][#<config>]`, checked before Zenoh sees them."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from riot_bus.vocabulary.errors import ConfigError, did_you_mean

PROTOCOLS = ("tcp", "tls", "quic", "udp", "ws", "unixsock-stream")
"""What the Zenoh wheel can listen on and connect to."""

ENCRYPTED = frozenset({"tls", "quic"})

_UNIX = "unixsock-stream"
_TRANSPORT = {"tcp": "tcp", "tls": "tcp", "ws": "tcp", "udp": "udp", "quic": "udp"}
_SEPARATOR = re.compile(rf",\s*(?=(?:{'|'.join(PROTOCOLS)})/|$)")
_LONGEST_SOCKET_PATH = 107  # `sun_path` of unix(7) has 108 bytes, of which the last is 0


@dataclass(frozen=True, slots=True)
class Endpoint:
    """One endpoint in its parts; `str()` gives it back as it was written."""

    protocol: str
    address: str
    metadata: str = ""
    config: str = ""

    def __str__(self) -> str:
        metadata = f"?{self.metadata}" if self.metadata else ""
        config = f"#{self.config}" if self.config else ""
        return f"{self.protocol}/{self.address}{metadata}{config}"

    @property
    def host(self) -> str:
        """Host without brackets, in lower case; empty for a socket file."""
        return "" if self.protocol == _UNIX else self.address.rpartition(":")[0].strip("[]").lower()

    @property
    def port(self) -> int:
        """Port; 0 for a socket file, and for a port that is chosen when the router starts."""
        return 0 if self.protocol == _UNIX else int(self.address.rpartition(":")[2])

    @property
    def parameters(self) -> dict[str, str]:
        """The config part: `a=1;b=2` as a table."""
        pairs = [part.partition("=") for part in self.config.split(";") if part]
        return {key: value for key, _, value in pairs}

    @property
    def is_local(self) -> bool:
        """Whether only this machine can reach it."""
        if self.protocol == _UNIX or self.host == "localhost":
            return True
        address = _ip(self.host)
        return address is not None and address.is_loopback

    @property
    def is_wildcard(self) -> bool:
        """Whether it stands for all addresses of this machine."""
        address = _ip(self.host)
        return address is not None and address.is_unspecified

    def with_parameters(self, parameters: Mapping[str, str]) -> Endpoint:
        """Return it with another config part."""
        config = ";".join(f"{key}={value}" if value else key for key, value in parameters.items())
        return replace(self, config=config)


def _ip(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return None
    mapped = address.ipv4_mapped if isinstance(address, ipaddress.IPv6Address) else None
    return mapped or address


def split_endpoints(text: str) -> list[str]:
    """Split `ENDPOINT[,ENDPOINT...]`; only a comma before a protocol separates, so an endpoint may contain others."""
    return [part for part in (each.strip() for each in _SEPARATOR.split(text)) if part]


def parse_endpoint(text: str, *, connect: bool = False) -> Endpoint:
    """Parse and check an endpoint.

    To `connect`, it needs a port other than 0.

    Raises:
        ConfigError: It cannot work; the message says why.
    """
    head, _, config = text.strip().partition("#")
    head, _, metadata = head.partition("?")
    protocol, slash, address = head.partition("/")
    if not slash or not address:
        raise ConfigError(f"{text!r} is not an endpoint", hint="write PROTOCOL/ADDRESS, such as tcp/127.0.0.1:7447")
    if protocol not in PROTOCOLS:
        raise ConfigError(f"unknown protocol {protocol!r} in {text!r}", hint=did_you_mean(protocol.lower(), PROTOCOLS))
    if protocol == _UNIX:
        _check_path(address, text)
    else:
        _check_address(protocol, address, text, connect=connect)
    return Endpoint(protocol, address, metadata, config)


def _check_path(address: str, text: str) -> None:
    if not address.startswith("/"):
        hint = f"write the whole path after the slash: {_UNIX}//tmp/riot.sock"
        raise ConfigError(f"{text!r} has no absolute path", hint=hint)
    if len(address.encode()) > _LONGEST_SOCKET_PATH:
        hint = f"the system allows {_LONGEST_SOCKET_PATH} bytes: choose a shorter folder, such as /tmp"
        raise ConfigError(f"the path in {text!r} is too long for a socket", hint=hint)


def _check_address(protocol: str, address: str, text: str, *, connect: bool) -> None:
    second = re.search(r",\s*([^,/\s]+)/", address)
    if second:
        raise ConfigError(
            f"unknown protocol {second.group(1)!r} in {text!r}", hint=did_you_mean(second.group(1).lower(), PROTOCOLS)
        )
    host, colon, port = address.rpartition(":")
    bare = _ip(address.strip("[]"))
    if isinstance(bare, ipaddress.IPv6Address) or (":" in host and not re.fullmatch(r"\[[^\[\]]+\]", host)):
        hint = f"write an IPv6 address in brackets, followed by a port: {protocol}/[::1]:7447"
        raise ConfigError(f"the address in {text!r} is not clear", hint=hint)
    if not colon:
        raise ConfigError(f"{text!r} has no port", hint=f"such as {protocol}/{address}:7447")
    if not host:
        raise ConfigError(f"{text!r} has no host", hint=f"such as {protocol}/127.0.0.1:{port or 7447}")
    if not re.fullmatch(r"[0-9]{1,5}", port) or int(port) > 65_535:
        raise ConfigError(f"{port!r} in {text!r} is not a port", hint="write a number from 0 to 65535")
    if connect and int(port) == 0:
        hint = "port 0 stands for any free port, which is only possible for listening"
        raise ConfigError(f"no client can connect to {text!r}", hint=hint)


def overlap(a: Endpoint, b: Endpoint) -> bool:
    """Return whether two listeners would conflict: the same socket file, or port and host."""
    if _UNIX in (a.protocol, b.protocol):
        return (a.protocol, a.address) == (b.protocol, b.address)
    if a.port != b.port or a.port == 0 or _TRANSPORT[a.protocol] != _TRANSPORT[b.protocol]:
        return False
    return a.is_wildcard or b.is_wildcard or _same(a.host) == _same(b.host)


def _same(host: str) -> str:
    return str(_ip("127.0.0.1" if host == "localhost" else host) or host)
