import pytest

pytest.importorskip("google.protobuf")

from riot_bus_protobuf.kind import ProtobufType
from riot_bus_protobuf.layout import Definitions
from riot_bus_testkit.types import TypeConformance
from tests.unit.types.proto_samples import SET, cls, every, legacy

DEFINITIONS = Definitions({each.name: each for each in SET.file})


class TestProto3(TypeConformance):
    kind = ProtobufType("test.Every", DEFINITIONS)
    payloads = (every().SerializeToString(), every(f_string="").SerializeToString() + b"\xa0\x7f\x05", b"")


class TestProto2(TypeConformance):
    kind = ProtobufType("old.Legacy", DEFINITIONS)
    payloads = (legacy().SerializeToString(), cls("old.Legacy")(id=1).SerializeToString())
