import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus_ros2.qos import RosQos, parse_offered
from tests.unit.riot_bus_ros2.ros_names import qos as announced
from tests.unit.riot_bus_ros2.ros_names import relaxed

NUMBERS = """- history: 1
  depth: {depth}
  reliability: {reliability}
  durability: {durability}
  deadline:
    sec: 9223372036
    nsec: 854775807
  liveliness: 1
  avoid_ros_namespace_conventions: false
"""


def offered(depth=10, reliability=1, durability=2):
    return NUMBERS.format(depth=depth, reliability=reliability, durability=durability)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", RosQos(depth=10)),
        ("[]", RosQos(depth=10)),
        ("nonsense: true", RosQos(depth=10)),
        (offered(), RosQos(depth=10)),
        (offered(depth=3, durability=1), RosQos(durability=1, depth=3)),
        (offered(reliability=2, depth=5), RosQos(reliability=2, depth=5)),
        ("- history: keep_last\n  depth: 1\n  durability: transient_local\n", RosQos(durability=1, depth=1)),
        ("- history: keep_all\n  depth: 0\n  reliability: Best_Effort\n", RosQos(reliability=2, history=2, depth=10)),
        ("- history: 2\n  depth: 7\n  reliability: reliable\n", RosQos(history=2, depth=7)),
        ("- depth: 99999999999999999999\n", RosQos(depth=10)),
        ("- depth: -3\n", RosQos(depth=10)),
    ],
)
def test_of_one_publisher(text, expected):
    assert parse_offered(text) == expected


def test_one_publisher_serves_the_subscribers_of_all():
    two = offered(depth=5, reliability=2) + offered(depth=20)
    assert parse_offered(two) == RosQos(depth=20)


def test_latched_messages_of_all_publishers_are_kept():
    three = offered(depth=1, durability=1) + offered(depth=2, durability=1) + offered(depth=100)
    assert parse_offered(three) == RosQos(durability=1, depth=3)


def test_what_late_joiners_get_is_bounded():
    assert RosQos(durability=1, depth=4).kept == 4
    assert RosQos(durability=1, history=2, depth=4).kept == 65536
    assert parse_offered(offered(depth=999999999, durability=1) * 3).kept == 65536


@pytest.mark.parametrize(
    ("qos", "token"),
    [
        (RosQos(depth=10), "::,10:,:,:,,"),
        (RosQos(depth=42), "::,:,:,:,,"),
        (RosQos(durability=1, depth=1), ":1:,1:,:,:,,"),
        (RosQos(reliability=2, depth=5), "2::,5:,:,:,,"),
        (RosQos(history=2, depth=42), "::2,:,:,:,,"),
    ],
)
def test_token(qos, token):
    assert qos.token() == token


@relaxed
@given(st.text(st.sampled_from("-:0123456789 \nabcdehilprstuvy_"), max_size=300))
def test_whatever_a_file_says_is_a_publisher(text):
    found = parse_offered(text)
    assert 0 < found.kept <= 65536
    assert found.token().count(":") == 5


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("::,:,:,:,,", RosQos()),
        ("::,10:,:,:,,", RosQos(depth=10)),
        (":1:,1:,:,:,,", RosQos(durability=1, depth=1)),
        ("2:1:2,7:1,5:60,3000:3,3,4", RosQos(2, 1, 2, 7, (1, 5), (60, 3000), 3, (3, 4))),
        ("1:2:1,10:0,0:0,0:1,0,0", RosQos(1, 2, 1, 10, (0, 0), (0, 0), 1, (0, 0))),
        ("1:2:1,10", RosQos(depth=10)),
    ],
)
def test_announced(text, expected):
    assert RosQos.parse(text) == expected


@relaxed
@given(announced)
def test_what_is_announced_is_read(qos):
    assert RosQos.parse(qos.token()) == qos


@relaxed
@given(announced)
def test_what_is_announced_is_what_a_bag_offers(qos):
    found = parse_offered(qos.profile())
    assert (found.reliable, found.latched, found.keep_all) == (
        qos.reliability != 2,
        qos.durability == 1,
        qos.history == 2,
    )
    assert RosQos.parse(found.token()) == found


@relaxed
@given(st.text(st.sampled_from(":,0123456789x-"), max_size=40) | st.text(max_size=20))
def test_whatever_is_announced_is_some_quality(text):
    found = RosQos.parse(text)
    assert RosQos.parse(found.token()) == found
