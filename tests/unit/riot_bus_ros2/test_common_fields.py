import pytest

from riot_bus.types.capabilities import AllowsNonFinite
from riot_bus_ros2.cdr import CdrType
from riot_bus_ros2.store import TypeStore


@pytest.mark.parametrize(
    ("name", "allowed", "others"),
    [
        ("LaserScan", ["ranges[0]", "ranges[*]", "intensities[3]"], ["angle_min", "range_max", "len(ranges)"]),
        ("BatteryState", ["percentage", "cell_voltage[1]"], ["header.stamp.sec"]),
        ("NavSatFix", ["altitude"], ["latitude"]),
        ("JointState", [], ["position[0]"]),
    ],
)
def test_what_may_be_nan_or_infinite_by_definition(name, allowed, others):
    one = CdrType(f"sensor_msgs/msg/{name}", TypeStore())
    assert isinstance(one, AllowsNonFinite)
    assert [path for path in (*allowed, *others) if one.allows_non_finite(path)] == allowed
