"""Codecs on a real bus: fields of messages are injected that no adapter knows, and their receivers decode them."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from riot_bus.inject.interceptor import Injector
from riot_bus.router.bus import Bus
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.injection import Injection
from tests.integration.bus_puppet import Puppet
from tests.integration.fault_tools import SEGMENTS, assert_balanced, pipeline, subscribed

pytest.importorskip("google.protobuf")
from tests.unit.types.proto_samples import SET, cls, every

pytestmark = pytest.mark.integration

COUNT = 50


def test_protobuf_and_structures_are_injected(tmp_path: Path) -> None:
    file = tmp_path / "types.desc"
    file.write_bytes(SET.SerializeToString())
    declared = {"cut/declared": "test.Every", "cut/struct": "raw(uint32 seq, float32 x)"}
    registry = TypeRegistry(declared=declared, definitions=[file])
    injections = [
        Injection("cut/declared", "f_int32", 1 << 20),
        Injection("cut/encoded", "inner.inner.f_string", "a much longer text than before"),
        Injection("cut/struct", "x", 2.5),
    ]
    interceptors = pipeline(Injector(injections), registry=registry)
    with (
        Bus(SEGMENTS, intercept=["cut/**"], pipeline=interceptors, registry=registry) as bus,
        Puppet(bus.endpoint("system")) as source,
        Puppet(bus.endpoint("unit")) as sink,
    ):
        sink.do("subscribe", key="cut/**")
        subscribed(bus, "unit", "cut/x")
        for number in range(COUNT):
            payload = every(f_int64=number).SerializeToString().hex()
            packed = struct.pack("<If", number, -1.0).hex()
            encoding = "application/protobuf;test.Every"
            source.do("put", key="cut/declared", payload=payload, congestion="BLOCK")
            source.do("put", key="cut/encoded", payload=payload, congestion="BLOCK", encoding=encoding)
            source.do("put", key="cut/struct", payload=packed, congestion="BLOCK")
        samples = sink.do("wait", count=3 * COUNT, timeout=60)
        got: dict[str, list[bytes]] = {}
        for each in samples:
            got.setdefault(each["key"], []).append(bytes.fromhex(each["payload"]))
        assert bus.drain(60)
        assert not interceptors.errors
        assert_balanced(bus)
    parse = cls("test.Every").FromString
    for number in range(COUNT):
        assert parse(got["cut/declared"][number]) == every(f_int64=number, f_int32=1 << 20)
        expected = every(f_int64=number)
        expected.inner.inner.f_string = "a much longer text than before"
        assert parse(got["cut/encoded"][number]) == expected
        assert got["cut/struct"][number] == struct.pack("<If", number, 2.5)
