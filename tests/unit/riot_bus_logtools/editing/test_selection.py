import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_logtools.editing.selection import Condition, parse_selection


def condition(text: str, origin: int = 0) -> Condition:
    return parse_selection(text, "--drop").condition(lambda: origin)


def never(path: str) -> bool:
    raise AssertionError(path)


def test_a_topic_alone_means_all_its_messages():
    selection = parse_selection("/odom", "--keep")
    assert (selection.topic, selection.whole) == ("/odom", True)
    assert selection.condition(lambda: 0).holds(5, 3, never)


def test_all_conditions_at_once_in_any_order():
    text = "robot/** every 2 during 1..2.5 index 4..8 where x > 3 and name == 'a where b'"
    selection = parse_selection(text, "--drop")
    assert (selection.topic, selection.whole, selection.during) == ("robot/**", False, ("1", "2.5"))
    found = selection.condition(lambda: 10**9)
    fields = {"x": 4.0, "name": "a where b"}
    assert found.holds(2 * 10**9, 4, fields.__getitem__)
    assert not found.holds(2 * 10**9 - 1, 4, fields.__getitem__)
    assert not found.holds(3 * 10**9 + 5 * 10**8, 4, fields.__getitem__)
    assert not found.holds(2 * 10**9, 5, fields.__getitem__)
    assert not found.holds(2 * 10**9, 2, fields.__getitem__)
    assert not found.holds(2 * 10**9, 8, fields.__getitem__)
    assert not found.holds(2 * 10**9, 4, {"x": 3.0, "name": "a where b"}.__getitem__)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a index 3", [3]),
        ("a index 3..5", [3, 4]),
        ("a index ..2", [0, 1]),
        ("a index 8..", [8, 9]),
        ("a every 4", [0, 4, 8]),
        ("a during 2..4", [2, 3]),
        ("a during 8..", [8, 9]),
        ("a during ..1", [0]),
        ("a during 1970-01-01T00:00:05..", [5, 6, 7, 8, 9]),
    ],
)
def test_ranges_have_open_ends_and_do_not_include_the_last(text, expected):
    found = condition(text)
    assert [n for n in range(10) if found.holds(n * 10**9, n, never)] == expected


def test_keys_of_ros_topics_may_be_named():
    key = "0/odom/nav_msgs::msg::dds_::Odometry_/TypeHashNotSupported"
    assert parse_selection(f"{key} index 3", "--drop").topic == key


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "names no topic"),
        (" where x > 1", "names no topic"),
        ("/odom:x where x > 1", "names a field"),
        ("/odom during 5", "not a span of time"),
        ("/odom during ..", "not a span of time"),
        ("/odom during 5..4", "not after"),
        ("/odom during x..4", "no time"),
        ("/odom index 4..4", "holds no number"),
        ("/odom index -1..4", "not numbers"),
        ("/odom index x", "not numbers"),
        ("/odom every 0", "not a number above 0"),
        ("/odom every -3", "not a number above 0"),
        ("/odom every 2 every 3", "cannot read"),
        ("/odom every 2 nonsense", "cannot read"),
        ("/odom where x >", "expected a number"),
    ],
)
def test_mistakes_are_explained(text, problem):
    with pytest.raises(ConfigError, match=problem) as caught:
        condition(text)
    assert "--drop" in str(caught.value)
