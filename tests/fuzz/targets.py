"""What reads bytes of strangers, each as a function: whatever comes, nothing is raised that is not expected."""

from __future__ import annotations

import json
import os
import tempfile
import tomllib
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from riot_bus.control.commands import Command, CommandRequest, answer
from riot_bus.inject.plan import parse_plan
from riot_bus.log.reader import LogReader
from riot_bus.report.finding_view import load
from riot_bus.report.markdown import MarkdownReport
from riot_bus.report.text import summary
from riot_bus.types.model import MessageType
from riot_bus.vocabulary.errors import ConfigError, PayloadError, RiotError
from riot_bus.vocabulary.predicate import parse_predicate
from riot_bus.vocabulary.selector import key_matches, parse_selector
from riot_bus.vocabulary.toml_text import parse_toml
from riot_bus_fleet.agent.request import PlayRequest, RecordRequest, parse_request
from riot_bus_fleet.scan import ScanRule
from riot_bus_fleet.testcases import load_case_template
from riot_bus_mavlink.adapter import MavlinkAdapter
from riot_bus_mavlink.frame import Framer
from riot_bus_ros2.adapter import Ros2Adapter

__all__ = ["TARGETS", "seeds"]

_TYPES = ("nav_msgs/msg/Odometry", "sensor_msgs/msg/LaserScan", "std_msgs/msg/String", "diagnostic_msgs/msg/KeyValue")
_MOST_LEAVES = 1000
_RECORDS = ("finding.json", "rule.json", "fields.json", "minimal.json", "permeability.json", "activation.json")


@cache
def _cdr(number: int) -> MessageType:
    found = Ros2Adapter().type_named(_TYPES[number % len(_TYPES)])
    assert found is not None
    return found


@cache
def _folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="riot-fuzz-"))


@cache
def _extras() -> Callable[[int], int | None]:
    messages = MavlinkAdapter().dialect.messages
    return lambda number: messages[number].crc_extra if number in messages else None


def cdr(data: bytes) -> None:
    """Read a CDR payload of one of some types, and write what was read."""
    kind, payload = _cdr(data[0] if data else 0), data[1:]
    try:
        leaves = list(kind.leaves(payload, elements=8))
    except PayloadError:
        return
    assert len(leaves) < _MOST_LEAVES
    for leaf in leaves[:8]:
        try:
            kind.rebuild(payload, {leaf.path: leaf.value})
        except PayloadError:
            continue


def mcap(data: bytes) -> None:
    """Read a log, damaged in whatever way, twice."""
    file = os.memfd_create("log")
    try:
        os.write(file, data)
        for salvage in (False, True):
            try:
                with LogReader(f"/proc/self/fd/{file}", salvage=salvage) as reader:
                    for message in reader.messages():
                        assert isinstance(message.payload, bytes)
                    str(reader.loss)
            except RiotError:
                continue
    finally:
        os.close(file)


def mavlink(data: bytes) -> None:
    """Find frames in a stream, whole and split: the same frames."""
    whole, split = Framer(_extras()), Framer(_extras())
    found = whole.feed(data) + whole.flush()
    middle = len(data) // 2
    pieces = split.feed(data[:middle]) + split.feed(data[middle:]) + split.flush()
    assert whole.counts.bytes == split.counts.bytes == len(data)
    assert all(frame.raw in data for frame in [*found, *pieces])


def selector(data: bytes) -> None:
    """Parse a selector with its predicate, and match a key."""
    text, _, key = data.decode("utf-8", "replace").partition("\0")
    try:
        found = parse_selector(text)
        assert parse_selector(str(found)) == found
        key_matches(found.topic, key or text)
        if found.where:
            parse_predicate(found.where)
    except ConfigError:
        return


def control(data: bytes) -> None:
    """Take a command with its payload, as from the network."""
    commands = {"echo": Command(lambda _, request: _told(request)), "play": Command(lambda _, r: _request(r.payload))}
    name, _, payload = data.partition(b"\0")
    try:
        made = answer(None, "r", name.decode("utf-8", "replace"), payload, {"name": "x"}, commands=commands)
    except RiotError as error:
        json.dumps(str(error))
        return
    json.loads(made)


def finding(data: bytes) -> None:
    """Read the records of a stranger's finding, a file each, as commands that only read do."""
    folder = _folder()
    for name, content in zip(_RECORDS, data.split(b"\0"), strict=False):
        (folder / name).write_bytes(content)
    ways: list[Callable[[], object]] = [
        lambda: MarkdownReport().render(load(folder)),
        lambda: summary(folder),
        lambda: load_case_template(folder),
        lambda: ScanRule(folder).registry(),
    ]
    for way in ways:
        with suppress(RiotError):
            way()
    for name in _RECORDS:
        (folder / name).unlink(missing_ok=True)


def toml(data: bytes) -> None:
    """Read a text as TOML, as Python does unless it is refused, then as an injection plan."""
    text = data.decode("utf-8", "replace")
    try:
        document = parse_toml(text, where="x")
        assert repr(document) == repr(tomllib.loads(text))  # which can show each integer
        parse_plan(text, name="x")
    except RiotError as error:
        json.dumps(str(error))


def _told(request: CommandRequest) -> dict[str, Any]:
    return {"arguments": request.arguments(), "name": request.name()}


def _request(payload: bytes) -> dict[str, Any]:
    for kind in (PlayRequest, RecordRequest):
        try:
            request = parse_request(kind, payload)
        except ConfigError:
            continue
        if isinstance(request, PlayRequest):
            request.check_plan()
        return {"operation": request.operation}
    return {}


TARGETS: dict[str, Callable[[bytes], None]] = {
    each.__name__: each for each in (cdr, mcap, mavlink, selector, control, finding, toml)
}
"""All targets by name."""


def seeds(name: str) -> list[bytes]:
    """Return inputs that reach deep into a target, to begin with."""
    return _SEEDS[name]()


def _cdr_seeds() -> list[bytes]:
    import random

    from tests.ros2_messages import encode, random_document

    documents = (random_document(name, random.Random(name)) for name in _TYPES)
    return [bytes([number]) + encode(_TYPES[number], document) for number, document in enumerate(documents)]


def _mcap_seeds() -> list[bytes]:
    import tempfile
    from pathlib import Path

    from riot_bus.log.writer import LogSettings, LogWriter
    from riot_bus.vocabulary.message import Message

    found = []
    for compression in ("zstd", "lz4", "none"):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "a.mcap"
            with LogWriter(path, LogSettings(compression=compression)) as writer:
                for number in range(3):
                    writer.write(Message(10**18 + number, "a", b'{"v": 1}', encoding="application/json"))
            found.append(path.read_bytes())
    return found


def _mavlink_seeds() -> list[bytes]:
    from riot_bus_mavlink.frame import pack_frame

    who = {"sequence": 1, "system": 1, "component": 1}
    extra = _extras()(30) or 0
    return [pack_frame(30, bytes(range(28)), extra, version=version, **who) * 2 for version in (1, 2)]


def _finding_seeds() -> list[bytes]:
    example = Path(__file__).parents[2] / "docs/rover-finding"
    return [b"\0".join((example / name).read_bytes() if (example / name).is_file() else b"" for name in _RECORDS)]


_SEEDS: dict[str, Callable[[], list[bytes]]] = {
    "toml": lambda: [
        b'[[inject]]\ntopic = "/odom"\nfield = "a.b[3]"\nvalue = nan\nwhere = "x > 3 and y == \'z\'"\nend = 4.0',
        b'[[inject]]\ntopic = "a/**"\nfield = "v"\nsignal = { center = 1.0, amplitude = 2e3, choices = [0xff, "x"] }\n',
        b'a . "b.\\"" . \'c\' = [ 1979-05-27, """\n""", { x.y = -1_000 } ] # c\n[[t.u]]\n',
        b"a." * 20 + b"a = 0x" + b"f" * 20,
    ],
    "cdr": _cdr_seeds,
    "mcap": _mcap_seeds,
    "mavlink": _mavlink_seeds,
    "finding": _finding_seeds,
    "selector": lambda: [
        b"/odom:twist.twist.linear.x where pose.x > 3 and not (a == 'b' or c <= -1.5e3)\0odom",
        b"a/**/b$*c/*:len(x[3].y[*])\0a/x/y/bqc/d",
    ],
    "control": lambda: [
        b'echo\0{"a": [1, 2.5, null]}',
        b'play\0{"operation": "0123456789abcdef", "secret": null, "logs": ["a.mcap"], '
        b'"on_lost_controller": "continue", '
        b'"inject": "[[inject]]\\ntopic = \\"a\\"\\nfield = \\"v\\"\\nvalue = 1\\n"}',
        b'play\0{"operation": "0123456789abcdef", "keys": ["**"], "duration": 3.5, "throttle": ["/a=5"]}',
    ],
}
