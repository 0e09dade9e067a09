import struct

import pytest

pytest.importorskip("pymavlink")

from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus_mavlink.adapter import MavlinkAdapter
from riot_bus_mavlink.parameters import ParameterKind, packed, unpacked

UINT8, INT16, INT32, INT64, REAL32 = 1, 4, 6, 8, 9


@pytest.mark.parametrize(
    ("value", "kind", "data"),
    [
        (1.5, ParameterKind(REAL32, cast=False), struct.pack("<f", 1.5)),
        (1.5, ParameterKind(REAL32, cast=True), struct.pack("<f", 1.5)),
        (7, ParameterKind(REAL32, cast=False), struct.pack("<f", 7)),
        (-8_000_000, ParameterKind(INT32, cast=False), struct.pack("<i", -8_000_000)),  # no float has these bytes
        (-8_000_000, ParameterKind(INT32, cast=True), struct.pack("<f", -8_000_000)),
        (-2, ParameterKind(INT16, cast=False), b"\xfe\xff\0\0"),
        (True, ParameterKind(UINT8, cast=False), b"\1\0\0\0"),
        (True, ParameterKind(UINT8, cast=True), struct.pack("<f", 1)),
    ],
)
def test_values_travel_in_the_form_of_their_autopilot(value, kind, data):
    assert packed(value, kind, name="A") == data
    assert unpacked(data, kind) == f"{value:g}" if isinstance(value, float) else str(int(value))


@pytest.mark.parametrize(
    ("value", "kind", "called"),
    [
        (256, ParameterKind(UINT8, cast=False), "uint8"),
        (256, ParameterKind(UINT8, cast=True), "uint8"),
        (-1, ParameterKind(UINT8, cast=True), "uint8"),
        (1e300, ParameterKind(REAL32, cast=False), "float32"),
    ],
)
def test_values_that_do_not_fit_are_refused(value, kind, called):
    with pytest.raises(PayloadError, match=f"it does not fit into {called}"):
        packed(value, kind, name="A")


@pytest.mark.parametrize(
    ("value", "kind", "problem"),
    [
        ("calm", ParameterKind(REAL32, cast=False), "cannot be 'calm'"),
        (1.0, ParameterKind(INT32, cast=True), "is an integer, not 1.0"),
        (1, ParameterKind(INT64, cast=False), "is of type 8"),
    ],
)
def test_values_of_other_types_are_mistakes(value, kind, problem):
    with pytest.raises(ConfigError, match=problem):
        packed(value, kind, name="A")


def test_components_are_named_by_two_ids():
    adapter = MavlinkAdapter()
    assert [adapter.has_parameters(each) for each in ("1/1", "255/190", "1/25")] == [True] * 3
    assert not any(map(adapter.has_parameters, ("1", "/1/1", "1/*", "0/1", "1/256", "1/1/1", "/planner", "")))
