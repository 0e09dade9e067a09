import pytest

from riot_bus_ros2.qos import FOREVER, RosQos, parse_offered


def profile(**settings):
    return RosQos(**settings).profile()


def test_what_a_bag_says_is_announced_again():
    qos = RosQos(reliability=2, durability=1, depth=7, deadline=(2, 5), lifespan=(9, 0), liveliness=3, lease=(0, 40))
    assert parse_offered(qos.profile()) == qos


def test_one_publisher_stands_for_all_recorded_ones():
    found = parse_offered(
        profile(deadline=(2, 0), lifespan=(9, 0)) + profile(deadline=(1, 5)) + profile(lease=(3, 0), liveliness=3)
    )
    assert (found.deadline, found.lifespan, found.liveliness, found.lease) == ((1, 5), FOREVER, 3, (3, 0))


@pytest.mark.parametrize("seconds", ["9223372036", "2147483647", "0", "99999999999999999999"])
def test_endless_durations_are_written_in_many_ways(seconds):
    text = f"- history: 1\n  deadline:\n    sec: {seconds}\n    nsec: 0\n  liveliness: automatic\n"
    assert parse_offered(text).deadline == FOREVER
    assert parse_offered(text).liveliness == 1
