import pytest

from riot_bus_protobuf.units import unit_in


@pytest.mark.parametrize(
    ("comment", "unit"),
    [
        ("start angle of the scan [rad]", "rad"),
        ("time between scans [seconds]", "s"),
        ("Negative when discharging (A)", "A"),
        ("Voltage in Volts (Mandatory)", "V"),
        ("Temperature in Degrees Celsius", "degC"),
        ("Absolute pressure reading in Pascals.", "Pa"),
        ("Latitude [degrees]. Positive is north of equator.", "deg"),
        ("unit: m/s", "m/s"),
        ("Units = rpm, as measured", "rpm"),
        ("speed in m/sec", "m/s"),
        ("[m/s²]", "m/s^2"),
        ("image height, that is, number of rows", ""),
        ("in the frame of the robot", ""),
        ("row-major, in A or B", ""),
        ("from [0] to [1] (inclusive)", ""),
        ("[m] or [deg]", ""),
        ("x (m), in degrees", "m"),
        ("", ""),
    ],
)
def test_units(comment, unit):
    assert unit_in(comment) == unit


def test_long_comments_are_cut():
    assert unit_in("(" * 1_000_000) == ""
    assert unit_in("in " * 1_000_000) == ""
