import pytest

from riot_bus.types.fields import FieldType
from riot_bus.types.listing import describe_named
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from tests.unit.types.proto_samples import SET


@pytest.fixture
def registry(tmp_path):
    file = tmp_path / "types.desc"
    file.write_bytes(SET.SerializeToString())
    return TypeRegistry(definitions=[file])


def test_a_type_is_described(registry):
    listing = describe_named("test.Vector", registry)
    assert (listing.name, listing.encoding, listing.problem) == ("test.Vector", "protobuf", "")
    assert listing.fields[0] == FieldType("x", "float64", unit="m")


def test_a_short_name_will_do(registry):
    assert describe_named("Vector", registry).name == "test.Vector"


def test_types_that_describe_themselves_have_no_fields(registry):
    assert describe_named("cbor", registry).fields == ()


def test_unknown_types(registry):
    with pytest.raises(ConfigError, match=r"test\.Vector"):
        describe_named("other.Vector", registry)
    with pytest.raises(ConfigError, match="unknown message type"):
        describe_named("Nothing", registry)
