from riot_bus.types.fields import FieldType
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.cdr import CdrType
from riot_bus_ros2.common_fields import UNITS
from riot_bus_ros2.definitions import parse_msg
from riot_bus_ros2.store import TypeStore

ROS2 = Ros2Adapter()


def fields(name):
    return {field.path: field for field in ROS2.type_named(name).fields()}


def test_bounds():
    kind = CdrType("pkg/msg/A", TypeStore(parse_msg("string<=5[<=3] a\nstring b\nint8[] c\nint8[2] d\n", "pkg/msg/A")))
    assert kind.fields() == [
        FieldType("len(a)", "uint32", high=3),
        FieldType("a[*]", "string", high=5),
        FieldType("b", "string"),
        FieldType("len(c)", "uint32"),
        FieldType("c[*]", "int8"),
        FieldType("d[*]", "int8", 2),
    ]


def test_constants_name_values_where_it_is_clear_of_which_field():
    found = fields("sensor_msgs/msg/NavSatFix")
    assert found["status.status"].names == (
        (-2, "STATUS_UNKNOWN"), (-1, "STATUS_NO_FIX"), (0, "STATUS_FIX"),
        (1, "STATUS_SBAS_FIX"), (2, "STATUS_GBAS_FIX"),
    )  # fmt: skip
    assert (4, "SERVICE_COMPASS") in found["status.service"].names
    assert (2, "COVARIANCE_TYPE_DIAGONAL_KNOWN") in found["position_covariance_type"].names
    assert (2, "ERROR") in fields("diagnostic_msgs/msg/DiagnosticStatus")["level"].names
    marker = fields("visualization_msgs/msg/Marker")
    assert (marker["type"].names, marker["id"].names, marker["header.frame_id"].names) == ((), (), ())


def test_units_of_vectors_depend_on_where_they_are():
    found = fields("nav_msgs/msg/Odometry")
    assert found["twist.twist.linear.x"].unit == "m/s"
    assert found["twist.twist.angular.z"].unit == "rad/s"
    assert found["pose.pose.position.y"].unit == "m"
    assert found["pose.pose.orientation.w"].unit == ""
    assert found["header.stamp.sec"].unit == "s"
    assert fields("sensor_msgs/msg/LaserScan")["ranges[*]"].unit == "m"


def test_all_units_are_of_fields():
    for name, units in UNITS.items():
        definition = ROS2.store.definition(name)
        assert definition is not None, name
        assert set(units) <= {field for field, _ in definition[1]}, name
