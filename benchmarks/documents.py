"""What one field costs in JSON, MessagePack, CBOR and Protocol Buffers: `python benchmarks/documents.py [--json FILE]`.

The same robot state in each encoding: 30 numbers, text, a nested pose, 100 ranges. Read the last field, patch it, list
all fields; beside it, the encoding's own library decodes and encodes the message to change the same field. Microseconds
of the processor's time that the thread takes per message: the median of many rounds.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cbor2
import msgpack
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from riot_bus.types.model import MessageType
from riot_bus.types.registry import TypeRegistry
from riot_bus_protobuf.source import ProtobufTypes

ROUNDS, BATCH = 200, 10
FIELD = "speed"
F = descriptor_pb2.FieldDescriptorProto


def state() -> dict[str, Any]:
    numbers: dict[str, Any] = {f"joint_{number}": number / 7 for number in range(30)}
    pose = {"position": {"x": 1.5, "y": -2.5, "z": 0.25}, "frame": "map"}
    return {**numbers, "mode": "autonomous", "pose": pose, "ranges": [n / 10 for n in range(100)], "speed": 1.25}


def add(message: Any, name: str, kind: int, *, target: str = "", repeated: bool = False) -> None:
    field = message.field.add(name=name, number=len(message.field) + 1, type=kind)
    if target:
        field.type_name = target
    field.label = F.LABEL_REPEATED if repeated else F.LABEL_OPTIONAL


def protobuf_state(document: dict[str, Any]) -> tuple[Any, bytes, MessageType]:
    """Return the library's class, the message, and our type."""
    found = descriptor_pb2.FileDescriptorSet()
    file = found.file.add(name="state.proto", package="bench", syntax="proto3")
    for name, fields in (("Point", ("x", "y", "z")), ("Pose", ())):
        message = file.message_type.add(name=name)
        for each in fields:
            add(message, each, F.TYPE_DOUBLE)
    add(message, "position", F.TYPE_MESSAGE, target=".bench.Point")
    add(message, "frame", F.TYPE_STRING)
    whole = file.message_type.add(name="State")
    for name, value in document.items():
        kind = {float: F.TYPE_DOUBLE, str: F.TYPE_STRING, dict: F.TYPE_MESSAGE, list: F.TYPE_DOUBLE}[type(value)]
        add(
            whole, name, kind, target=".bench.Pose" if isinstance(value, dict) else "", repeated=isinstance(value, list)
        )
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)  # type: ignore[no-untyped-call,unused-ignore]
    made = message_factory.GetMessageClass(pool.FindMessageTypeByName("bench.State"))  # type: ignore[no-untyped-call,unused-ignore]
    types = ProtobufTypes()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "state.desc")
        path.write_bytes(found.SerializeToString())
        types.load([path])
    kind_ = types.type_named("bench.State")
    assert kind_ is not None
    return made, made(**document).SerializeToString(), kind_


def contenders() -> dict[str, Callable[[], object]]:
    document, registry = state(), TypeRegistry()
    made, packed, proto = protobuf_state(document)

    def changed(decode: Callable[[bytes], Any], encode: Callable[[Any], bytes], payload: bytes) -> Callable[[], bytes]:
        def act() -> bytes:
            found = decode(payload)
            found[FIELD] = 2.5
            return encode(found)

        return act

    def changed_proto() -> bytes:
        found = made.FromString(packed)
        found.speed = 2.5
        return bytes(found.SerializeToString())

    encodings: dict[str, tuple[MessageType | None, bytes, Callable[[], bytes]]] = {
        name: (registry.type_named(name), encode(document), changed(decode, encode, encode(document)))
        for name, decode, encode in (
            ("json", json.loads, lambda each: json.dumps(each).encode()),
            ("msgpack", msgpack.unpackb, msgpack.packb),
            ("cbor", cbor2.loads, cbor2.dumps),
        )
    }
    encodings["protobuf"] = proto, packed, changed_proto
    acts: dict[str, Callable[[], object]] = {}
    for name, (kind, payload, library) in encodings.items():
        assert kind is not None
        assert kind.read(payload, FIELD) == 1.25
        assert kind.read(kind.patch(payload, {FIELD: 2.5}), FIELD) == kind.read(library(), FIELD) == 2.5
        acts |= {
            f"{name}: read": lambda kind=kind, payload=payload: kind.read(payload, FIELD),  # type: ignore[misc]
            f"{name}: patch": lambda kind=kind, payload=payload: kind.patch(payload, {FIELD: 2.5}),  # type: ignore[misc]
            f"{name}: all fields": lambda kind=kind, payload=payload: kind.leaves(payload),  # type: ignore[misc]
            f"{name}: its library, decode + encode": library,
        }
    return acts


def measure(rounds: int) -> dict[str, float]:
    """Return microseconds per message."""
    acts = contenders()
    found: dict[str, list[float]] = {name: [] for name in acts}
    for _ in range(rounds):
        for name, act in acts.items():
            begin = time.thread_time_ns()
            for _ in range(BATCH):
                act()
            found[name].append((time.thread_time_ns() - begin) / BATCH / 1000)
    return {name: statistics.median(values) for name, values in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"of {BATCH} messages each")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    args = parser.parse_args()
    found = measure(args.rounds)
    for name, value in found.items():
        print(f"{name:38}{value:8.2f} us")
    if args.json is not None:
        args.json.write_text(json.dumps({"us": found}, indent=2))


if __name__ == "__main__":
    main()
