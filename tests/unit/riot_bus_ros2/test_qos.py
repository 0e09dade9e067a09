import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus_ros2.qos import RosQos, parse_offered

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
        ("", RosQos()),
        ("[]", RosQos()),
        ("nonsense: true", RosQos()),
        (offered(), RosQos(depth=10)),
        (offered(depth=3, durability=1), RosQos(latched=True, depth=3)),
        (offered(reliability=2, depth=5), RosQos(reliable=False, depth=5)),
        ("- history: keep_last\n  depth: 1\n  durability: transient_local\n", RosQos(latched=True, depth=1)),
        ("- history: keep_all\n  depth: 0\n  reliability: Best_Effort\n", RosQos(reliable=False, keep_all=True)),
        ("- history: 2\n  depth: 7\n  reliability: reliable\n", RosQos(keep_all=True, depth=7)),
        ("- depth: 99999999999999999999\n", RosQos()),
        ("- depth: -3\n", RosQos()),
    ],
)
def test_of_one_publisher(text, expected):
    assert parse_offered(text) == expected


def test_one_publisher_serves_the_subscribers_of_all():
    two = offered(depth=5, reliability=2) + offered(depth=20)
    assert parse_offered(two) == RosQos(depth=20)


def test_latched_messages_of_all_publishers_are_kept():
    three = offered(depth=1, durability=1) + offered(depth=2, durability=1) + offered(depth=100)
    assert parse_offered(three) == RosQos(latched=True, depth=3)


def test_what_late_joiners_get_is_bounded():
    assert RosQos(latched=True, depth=4).kept == 4
    assert RosQos(latched=True, keep_all=True, depth=4).kept == 65536
    assert parse_offered(offered(depth=999999999, durability=1) * 3).kept == 65536


@pytest.mark.parametrize(
    ("qos", "token"),
    [
        (RosQos(depth=10), "::,10:,:,:,,"),
        (RosQos(depth=42), "::,:,:,:,,"),
        (RosQos(latched=True, depth=1), ":1:,1:,:,:,,"),
        (RosQos(reliable=False, depth=5), "2::,5:,:,:,,"),
        (RosQos(keep_all=True, depth=42), "::2,:,:,:,,"),
    ],
)
def test_token(qos, token):
    assert qos.token() == token


@given(st.text(st.sampled_from("-:0123456789 \nabcdehilprstuvy_"), max_size=300))
def test_whatever_a_file_says_is_a_publisher(text):
    found = parse_offered(text)
    assert 0 < found.kept <= 65536
    assert found.token().count(":") == 5
