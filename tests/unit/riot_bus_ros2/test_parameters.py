import pytest

pytest.importorskip("mcap_ros2")

from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus_ros2.parameters import refused_by, request_of
from riot_bus_ros2.store import TypeStore
from tests.ros2_messages import encode

SERVICE = "rcl_interfaces/srv/SetParameters"
STORE = TypeStore()


def test_a_request_has_each_value_in_its_type():
    values = {"a.gain": 1.5, "count": -3, "on": True, "name": "calm \u00e4", "off": False, "zero": 0.0}
    found = STORE.decode(request_of(values, STORE), f"{SERVICE}_Request").parameters
    assert [each.name for each in found] == list(values)
    assert [each.value.type for each in found] == [3, 2, 1, 4, 1, 3]
    told = [(one.double_value, one.integer_value, one.bool_value, one.string_value) for one in (p.value for p in found)]
    assert told == [
        (1.5, 0, False, ""),
        (0.0, -3, False, ""),
        (0.0, 0, True, ""),
        (0.0, 0, False, "calm \u00e4"),
        (0.0, 0, False, ""),
        (0.0, 0, False, ""),
    ]


def test_bytes_are_no_parameter():
    with pytest.raises(ConfigError, match="parameter 'a' cannot be b'x'"):
        request_of({"a": b"x"}, STORE)


def test_refusals_have_the_reason_of_the_node():
    results = [{"successful": True, "reason": ""}, {"successful": False, "reason": "at most 10"}]
    results.append({"successful": False, "reason": ""})
    reply = encode(f"{SERVICE}_Response", {"results": results})
    assert refused_by(reply, ["a", "b", "c"], STORE) == {"b": "at most 10", "c": "it gives no reason"}
    with pytest.raises(PayloadError, match="3 results for 2 parameters"):
        refused_by(reply, ["a", "b"], STORE)
    with pytest.raises(PayloadError):
        refused_by(reply[:9], ["a", "b"], STORE)
