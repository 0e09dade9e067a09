"""Parser of links in the notations of pymavlink, MAVSDK, mavlink-server and mavlink-router."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from urllib.parse import parse_qsl

from riot_bus.vocabulary.errors import ConfigError, did_you_mean

_LARGEST = {"msg_id": (1 << 24) - 1, "src_sys": 255, "src_comp": 255}  # 24, 8 and 8 bits in a frame
_FIELDS = [(action, what) for action in ("allow", "block") for what in _LARGEST]

FILTER_NAMES = {way: frozenset(f"{action}_{what}_{way}" for action, what in _FIELDS) for way in ("in", "out")}
"""Names of the settings: `allow_msg_id_in`, `block_src_sys_out`, ..."""


@dataclass(frozen=True, slots=True)
class Filter:
    """Filter that passes what every non-empty allow list names and no block list names."""

    allow_msg_id: frozenset[int] = frozenset()
    allow_src_sys: frozenset[int] = frozenset()
    allow_src_comp: frozenset[int] = frozenset()
    block_msg_id: frozenset[int] = frozenset()
    block_src_sys: frozenset[int] = frozenset()
    block_src_comp: frozenset[int] = frozenset()

    @property
    def is_open(self) -> bool:
        """Whether everything passes."""
        return not any(getattr(self, f"{action}_{what}") for action, what in _FIELDS)

    def passes(self, message_id: int, system: int, component: int) -> bool:
        """Return whether a message of a source passes."""
        return (
            (not self.allow_msg_id or message_id in self.allow_msg_id)
            and message_id not in self.block_msg_id
            and (not self.allow_src_sys or system in self.allow_src_sys)
            and system not in self.block_src_sys
            and (not self.allow_src_comp or component in self.allow_src_comp)
            and component not in self.block_src_comp
        )


def filter_of(settings: Mapping[str, str], id_of: Callable[[str], int | None], *, where: str = "") -> Filter:
    """Return the filter that settings describe; raises ConfigError for unknown messages and numbers out of range."""
    lists: dict[str, frozenset[int]] = {}
    for key, text in settings.items():
        name = key.rpartition("_")[0]
        what = name.partition("_")[2]
        words = [word.strip() for word in text.split(",") if word.strip()]
        lists[name] = frozenset(_listed(word, what, id_of, where=where, key=key) for word in words)
    return Filter(**lists)


def _listed(word: str, what: str, id_of: Callable[[str], int | None], *, where: str, key: str) -> int:
    if word.isascii() and word.isdigit() and len(word) < 10:
        if int(word) <= _LARGEST[what]:
            return int(word)
        raise ConfigError(f"{key}: {word} is over {_LARGEST[what]}", where=where)
    found = id_of(word) if what == "msg_id" else None
    if found is None:
        hint = "numbers or names of messages, such as 0 or HEARTBEAT" if what == "msg_id" else "numbers from 1 to 255"
        raise ConfigError(f"{key}: {word!r} is not known", where=where, hint=hint)
    return found


DEFAULT_BAUD = 57600  # MAVSDK's default, and that of usual telemetry radios
_MOST_LINKS = 256  # a guess: a quarter of the 1024 descriptors that a process usually may open
_HINT = "such as udpin:0.0.0.0:14550, udpout:127.0.0.1:14550, tcp:127.0.0.1:5760 or /dev/ttyACM0,115200"
_SETTINGS = frozenset({"baud", "direction", "group", "name", "rate", "timeout"})
_LISTS = FILTER_NAMES["in"] | FILTER_NAMES["out"]
_NAMED = re.compile(r"(?P<segment>[A-Za-z0-9_-]+)?(?:/(?P<name>[A-Za-z0-9_.-]+))?=(?P<url>.*)", re.DOTALL)
_LONGEST_NAME = 60  # with a number of up to three digits, no longer than `_NAME` allows
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}")


class LinkKind(StrEnum):
    """Kind of a link."""

    UDP_SERVER = "udp server"
    UDP_CLIENT = "udp client"
    TCP_SERVER = "tcp server"
    TCP_CLIENT = "tcp client"
    SERIAL = "serial"
    LOG_READER = "log reader"
    LOG_WRITER = "log writer"


class Direction(StrEnum):
    """Which way frames go over a link, seen from the bridge."""

    BOTH = "both"
    RECEIVER = "receiver"
    SENDER = "sender"


_SCHEMES = {
    **dict.fromkeys(("udpin", "udpserver", "udps", "udp"), LinkKind.UDP_SERVER),
    **dict.fromkeys(("udpout", "udpclient", "udpc", "udpbcast"), LinkKind.UDP_CLIENT),
    **dict.fromkeys(("tcpin", "tcpserver", "tcps"), LinkKind.TCP_SERVER),
    **dict.fromkeys(("tcpout", "tcpclient", "tcpc", "tcp"), LinkKind.TCP_CLIENT),
    "serial": LinkKind.SERIAL,
    **dict.fromkeys(("tlogreader", "tlogr"), LinkKind.LOG_READER),
    **dict.fromkeys(("tlogwriter", "tlogw"), LinkKind.LOG_WRITER),
}
FILES = frozenset({LinkKind.LOG_READER, LinkKind.LOG_WRITER})
LISTENS = frozenset({LinkKind.UDP_SERVER, LinkKind.TCP_SERVER})


@dataclass(frozen=True, slots=True)
class LinkSpec:
    """One link.

    Attributes:
        host: Address to listen on or to connect to; empty for serial links and files.
        baud: Baud rate of a serial link, bit/s.
        name: Name in keys, counts and messages; unique within a bridge.
        segment: Name of the segment that it belongs to; empty for the only one.
        group: Parallel links of one group know the same systems and do not forward to each other; empty for none.
        silence: Seconds after which a silent peer of a UDP server is forgotten, and a TCP connection whose other end
            acknowledges nothing is ended.
        rate: Speed at which a log is read, relative to its recording; 0 for as fast as possible.
    """

    kind: LinkKind
    host: str = ""
    port: int = 0
    path: str = ""
    baud: int = DEFAULT_BAUD
    name: str = ""
    segment: str = ""
    group: str = ""
    direction: Direction = Direction.BOTH
    silence: float = 30.0
    rate: float = 1.0
    accepts: Filter = field(default_factory=Filter)
    emits: Filter = field(default_factory=Filter)
    text: str = ""

    @property
    def url(self) -> str:
        """Return the text of the link without segment and name."""
        named = _NAMED.fullmatch(self.text)
        return self.text if named is None else named["url"]

    @property
    def where(self) -> str:
        """Return the place as text: an address, a device or a file."""
        if self.path:
            return f"{self.path}:{self.baud}" if self.kind is LinkKind.SERIAL else self.path
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{host}:{self.port}"


def parse_links(
    texts: Sequence[str], *, id_of: Callable[[str], int | None] = lambda name: None, segments: Sequence[str] = ()
) -> list[LinkSpec]:
    """Parse all links of a bridge and give names to those that have none.

    Args:
        segments: Names of the segments; if there are several, each link must name its own.

    Raises:
        ConfigError: A link is not usable, names no segment, or has the name of another.
    """
    if len(texts) > _MOST_LINKS:
        raise ConfigError(f"{len(texts)} links", where="--link", hint=f"a bridge has at most {_MOST_LINKS}")
    found: list[LinkSpec] = []
    taken: set[str] = set()
    specs = [parse_link(text, id_of=id_of) for text in texts]
    for spec in specs:
        if spec.name in taken:
            raise ConfigError(f"several links are called {spec.name!r}", where=spec.text, hint="choose another name")
        taken |= {spec.name} - {""}
    for spec in specs:
        segment = _segment_of(spec, segments)
        name = spec.name or free_name(_usual_name(spec), taken)
        found.append(replace(spec, name=name, segment=segment))
    return found


def parse_link(text: str, *, id_of: Callable[[str], int | None] = lambda name: None) -> LinkSpec:
    """Parse one link, `[SEGMENT][/NAME]=URL` or `URL`.

    A URL is `SCHEME:HOST:PORT`, `SCHEME://HOST:PORT`, `SCHEME:PORT`, `serial:DEVICE:BAUD`, `DEVICE,BAUD`, or the path
    of a `.tlog` file, followed by settings such as `?name=gcs&group=radio&block_msg_id_out=HEARTBEAT`.

    Raises:
        ConfigError: It is not usable; the message says why.
    """
    segment = name = ""
    body = text.strip()
    named = _NAMED.fullmatch(body)
    if named is not None:
        segment, name, body = named["segment"] or "", named["name"] or "", named["url"].strip()
    body, _, query = body.partition("?")
    settings = _settings(query, text)
    kind, rest = _kind_of(body, text)
    host, port, path, baud = "", 0, "", DEFAULT_BAUD
    if kind is LinkKind.SERIAL:
        path, baud = _device(rest, settings, text)
    elif kind in FILES:
        path = rest
    else:
        host, port = _address(kind, rest, text)
    if kind in FILES | {LinkKind.SERIAL} and not path:
        raise ConfigError(f"{text!r} has no path", where="--link", hint=_HINT)
    name = settings.pop("name", name)
    if name and not _NAME.fullmatch(name):
        raise ConfigError(
            f"{name!r} is not a name for a link", where=text, hint="use letters, digits, '_', '-' and '.'"
        )
    group = settings.pop("group", "")
    direction = _direction(settings, kind, text)
    silence = _seconds(settings.pop("timeout", "30"), text)
    rate = _number(settings.pop("rate", "1"), text)
    accepts, emits = (
        filter_of({key: settings.pop(key) for key in list(settings) if key in FILTER_NAMES[way]}, id_of, where=text)
        for way in ("in", "out")
    )
    if settings:
        unknown = sorted(settings)[0]
        known = _SETTINGS | _LISTS
        raise ConfigError(f"unknown setting {unknown!r}", where=text, hint=did_you_mean(unknown, known))
    return LinkSpec(
        kind, host, port, path, baud, name, segment, group, direction, silence, rate, accepts, emits, text.strip()
    )


def _kind_of(body: str, text: str) -> tuple[LinkKind, str]:
    if body.startswith("/"):
        return (LinkKind.LOG_READER if body.endswith(".tlog") else LinkKind.SERIAL), body
    scheme, colon, rest = body.partition(":")
    kind = _SCHEMES.get(scheme.lower())
    if kind is None and body.endswith(".tlog"):
        return LinkKind.LOG_READER, body
    if not colon:
        raise ConfigError(f"{text!r} is not a link", where="--link", hint=_HINT)
    if kind is None:
        raise ConfigError(
            f"unknown kind of link {scheme!r} in {text!r}",
            where="--link",
            hint=did_you_mean(scheme.lower(), _SCHEMES) if not re.search(r"[0-9.\[]", scheme) else _HINT,
        )
    return kind, rest.removeprefix("//")


def _settings(query: str, text: str) -> dict[str, str]:
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query), max_num_fields=64)
    except ValueError as error:
        hint = "?KEY=VALUE&KEY=VALUE"
        raise ConfigError(f"cannot read the settings in {text!r}", where="--link", hint=hint) from error
    settings: dict[str, str] = {}
    for key, value in pairs:
        name = re.sub(r"(?<=[a-z])(?=[A-Z])|-", "_", key).lower()
        if name in settings:
            hint = f"several values are separated by commas: {key}=1,2" if name in _LISTS else "name it once"
            raise ConfigError(f"the setting {key!r} is there twice", where=text, hint=hint)
        settings[name] = value
    return settings


def _address(kind: LinkKind, rest: str, text: str) -> tuple[str, int]:
    rest = rest.rstrip("/")
    if rest.isdigit():
        rest = f":{rest}"
    host, colon, port = rest.rpartition(":")
    if not colon or not re.fullmatch(r"[0-9]{1,5}", port) or int(port) > 65535:
        raise ConfigError(f"{text!r} has no port", where="--link", hint=_HINT)
    bare = host.strip("[]")
    if ":" in bare and not re.fullmatch(r"\[[^\[\]]+\]", host):
        raise ConfigError(f"the address in {text!r} is not clear", where="--link", hint="brackets: udpin:[::1]:14550")
    if kind not in LISTENS and (not bare or int(port) == 0):
        raise ConfigError(f"{text!r} is not an address to connect to", where="--link", hint=_HINT)
    if re.search(r"[\s/@,]", bare):
        raise ConfigError(f"{bare!r} in {text!r} is not a host", where="--link", hint=_HINT)
    return bare or "0.0.0.0", int(port)  # noqa: S104 - as those spellings mean


def _device(rest: str, settings: dict[str, str], text: str) -> tuple[str, int]:
    path, baud = rest, ""
    for mark in (",", ":"):
        head, separator, tail = rest.rpartition(mark)
        if separator and tail.isdigit():
            path, baud = head, tail
            break
    for key in ("baud", "baudrate", "arg2"):
        baud = settings.pop(key, baud)
    if baud and (not baud.isdigit() or not 0 < int(baud[:9]) <= 20_000_000 or len(baud) > 8):
        raise ConfigError(f"{baud!r} is not a rate of a serial link", where=text, hint="such as 57600 or 115200")
    return path, int(baud or DEFAULT_BAUD)


def _direction(settings: dict[str, str], kind: LinkKind, text: str) -> Direction:
    usual = {LinkKind.LOG_READER: Direction.RECEIVER, LinkKind.LOG_WRITER: Direction.SENDER}.get(kind, Direction.BOTH)
    word = settings.pop("direction", usual).lower()
    if word not in list(Direction):
        raise ConfigError(f"unknown direction {word!r}", where=text, hint=did_you_mean(word, Direction))
    if kind in FILES and word != usual:
        raise ConfigError(f"a {kind} is no {word}", where=text)
    return Direction(word)


def _number(text: str, where: str) -> float:
    if not re.fullmatch(r"[0-9]{1,9}(\.[0-9]{1,9})?", text):
        raise ConfigError(f"{text!r} is not a number", where=where, hint="such as 30 or 0.5")
    return float(text)


def _seconds(text: str, where: str) -> float:
    found = _number(text, where)
    if found <= 0:
        raise ConfigError(f"{text!r} is not a duration", where=where, hint="seconds, such as timeout=30")
    return found


def _segment_of(spec: LinkSpec, segments: Sequence[str]) -> str:
    if spec.segment:
        if segments and spec.segment not in segments:
            raise ConfigError(
                f"no segment {spec.segment!r}", where=spec.text, hint=did_you_mean(spec.segment, segments)
            )
        return spec.segment
    if len(segments) > 1:
        raise ConfigError(
            f"to which segment does {spec.text!r} belong?", where="--link", hint=f"write {segments[0]}={spec.text}"
        )
    return segments[0] if segments else ""


def _usual_name(spec: LinkSpec) -> str:
    if not spec.path:
        return f"{spec.kind.partition(' ')[0]}{spec.port or ''}"
    stem = spec.path.rpartition("/")[2].removesuffix(".tlog")
    return re.sub(r"[^A-Za-z0-9_-]+", "_", stem).strip("_") or "file"


def free_name(base: str, taken: set[str]) -> str:
    """Return a name, with a number if it is taken, and add it to the taken ones."""
    name, number = base[:_LONGEST_NAME], 1
    while name in taken:
        number += 1
        name = f"{base[:_LONGEST_NAME]}_{number}"
    taken.add(name)
    return name
