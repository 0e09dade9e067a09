from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.router.bus import Bus
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_conformance.run import OURS, Difference, WayOutcome, compare, run_scenario
from riot_bus_conformance.scenario import Scenario, find, load
from riot_bus_conformance.verdict import verdicts

SCENARIOS = load()


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("transparency")


@pytest.mark.integration
@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=str)
def test_the_bus_is_not_noticed(scenario: Scenario, certificates: Path) -> None:
    outcomes = [run_scenario(scenario, way, folder=certificates) for way in OURS]
    if outcomes[0].skipped is not None:
        pytest.skip(outcomes[0].skipped)
    differences = compare(outcomes)
    assert [str(each) for each in differences if each.way not in scenario.limits] == []
    assert {each.way for each in differences} == set(scenario.limits), "a documented difference is gone: say so there"


@pytest.mark.integration
def test_a_running_router_is_compared_with_a_plain_one() -> None:
    chosen = ("put_delete", "matching", "router_restart")
    with Bus({"left": (), "right": ()}) as bus:
        found = {each.scenario: each for each in verdicts((bus.endpoint("left"), bus.endpoint("right")), only=chosen)}
    assert {name: found[name].differences for name in chosen} == dict.fromkeys(chosen, ())
    assert [found[name].skipped for name in chosen] == [None, None, "needs a router of our own: router"]


@pytest.mark.integration
def test_a_router_that_is_not_there_is_an_error_of_its_way() -> None:
    outcome = run_scenario(find("put_delete"), "router", ("tcp/127.0.0.1:1", "tcp/127.0.0.1:1"))
    assert outcome.error is not None
    assert "nobody answers at tcp/127.0.0.1:1" in outcome.error


def test_differences_name_their_place() -> None:
    plain = WayOutcome("plain", {"right": [{"a": 1, "b": [1]}], "left": None})
    other = WayOutcome("native", {"right": [{"a": 2, "b": [1, 2]}], "left": None}, losses=("a link broke",))
    assert compare([plain, other]) == [
        Difference("native", "right[0].a", 1, 2),
        Difference("native", "right[0].b", [1], [1, 2]),
        Difference("native", "losses", "none", "a link broke"),
    ]


def test_a_way_that_failed_differs_and_one_that_was_skipped_does_not() -> None:
    plain = WayOutcome("plain", {"left": 1})
    failed, skipped = WayOutcome("native", error="broke"), WayOutcome("intercepted", skipped="no openssl")
    assert [str(each) for each in compare([plain, failed, skipped])] == [
        "native: outcome: 'broke' instead of 'an observation'"
    ]
    assert compare([skipped]) == []


def test_an_unknown_scenario_is_an_error_with_a_hint() -> None:
    with pytest.raises(ConfigError, match="did you mean 'put_delete'"):
        find("put_delet")


@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=str)
def test_scenarios_say_what_they_do_and_limit_only_our_ways(scenario: Scenario) -> None:
    assert scenario.summary.endswith(".")
    assert set(scenario.limits) <= {"native", "junction", "intercepted"}
