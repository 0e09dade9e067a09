from riot_bus_bridges.ros2.bridge import summary_lines


def test_what_crossed_is_a_table():
    status = {
        "topics": {"/odom": {"to_segment": 12, "to_domain": 0}, "/cmd_vel": {"to_segment": 0, "to_domain": 1234567}},
        "services": {"/switch": 3},
        "lost": {"/scan": 5},
        "refused": {"/odom": 2},
    }
    assert summary_lines(status) == [
        "/scan: 5 messages of the domain were lost",
        "/odom: 2 messages too short to be valid were left out",
        "          to segment  to domain",
        "/odom             12          0",
        "/cmd_vel           0    1234567",
        "/switch      3 calls",
    ]
    assert summary_lines({"topics": {}, "services": {}, "lost": {}, "refused": {}}) == ["there was nothing to bridge"]
