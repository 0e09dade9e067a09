from __future__ import annotations

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.selector import Selector, check_wildcards, key_matches, parse_selector, split_field
from riot_bus.zenoh.session import canonical

chunk = st.sampled_from(["a", "b", "ab", "aab", "aba", "@v", "@va", "a.b", "std_msgs::msg::String_"])


wild = st.sampled_from(["a", "b", "*", "**", "a$*", "$*b", "a$*a", "$*a$*b$*", "@v"])


@given(st.lists(wild, min_size=1, max_size=7), st.lists(chunk, min_size=1, max_size=7))
def test_key_matches_as_zenoh_does(expression: list[str], key: list[str]) -> None:
    text = str(zenoh.KeyExpr.autocanonize("/".join(expression)))
    assert key_matches(text, "/".join(key)) == zenoh.KeyExpr(text).intersects(zenoh.KeyExpr("/".join(key)))


@pytest.mark.parametrize("expression", ["$*a" * 40 + "$*c", "**/a/" * 40 + "c", "**/$*a$*a$*a$*a$*a$*c/" * 40 + "c"])
def test_many_wildcards_take_no_longer_than_the_key_is_long(expression: str) -> None:
    key = "/".join(["a" * 100] * 100)  # by backtracking this would not end within a lifetime
    assert not key_matches(expression, key + "/b")
    assert not key_matches(expression, "a" * 60_000)


@pytest.mark.parametrize(
    ("text", "selector"),
    [
        ("/odom", Selector("/odom")),
        ("/odom:twist.twist.linear.x", Selector("/odom", "twist.twist.linear.x")),
        ("a/**:len(ranges)", Selector("a/**", "len(ranges)")),
        ("cmd:v[3].x where mode == 2", Selector("cmd", "v[3].x", "mode == 2")),
        ("0/odom/nav_msgs::msg::dds_::Odometry_/*:pose", Selector("0/odom/nav_msgs::msg::dds_::Odometry_/*", "pose")),
    ],
)
def test_selectors(text: str, selector: Selector) -> None:
    assert parse_selector(text) == selector
    assert parse_selector(str(selector)) == selector


@pytest.mark.parametrize(
    ("expression", "whole"),
    [
        ("x/$*a$*a", False),
        ("x/" + "$*a" * 8 + "$*b", False),
        ("a$*b$*c/x", False),
        ("**/a/**/b", False),
        ("**/" + "a/" * 32 + "b", False),
        ("@riot/$*a$*b/agent/status", False),
        ("*/robot/**/$*::dds_::$*/*/**", True),
        ("**/x/**", True),
        ("c$*t/x$*/$*y$*", True),
        ("a/" * 400 + "**", True),
        ("**/" + "a/" * 30 + "b", True),
    ],
)
def test_expressions_that_zenoh_would_take_long_to_match_are_refused(expression: str, whole: bool) -> None:
    for check in (lambda: check_wildcards(expression), lambda: canonical([expression])):  # all that riot hands over
        if whole:
            check()
            continue
        with pytest.raises(ConfigError, match="too many wildcards") as caught:
            check()
        assert "at most one $*" in (caught.value.hint or "")


@given(st.text("a:\n"))
def test_a_topic_ends_at_the_first_colon_that_stands_alone(text: str) -> None:
    topic, field = split_field(text)
    assert topic.replace("::", "").count(":") == 0
    assert text in (topic, f"{topic}:{field}")


def test_a_topic_of_many_colons_is_read_in_a_time_that_grows_with_it() -> None:
    assert split_field("a::" * (1 << 20) + "b:c") == ("a::" * (1 << 20) + "b", "c")  # took minutes


@pytest.mark.parametrize("text", ["", ":x", "a:", "a:b..c", "a:1x", "a:b[" + "1" * 5000 + "]"])
def test_wrong_selectors(text: str) -> None:
    with pytest.raises(ConfigError):
        parse_selector(text)
