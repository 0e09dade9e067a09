from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.log.limits import tight_limits
from riot_bus.play.options import PlayOptions
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_fleet.agent.options import AgentOptions
from riot_bus_fleet.agent.request import (
    ControllerWatch,
    Lead,
    PlayRequest,
    Policy,
    RecordRequest,
    check_key,
    parse_request,
)

AGENT = AgentOptions(robot="r7", folder=Path("/logs"), endpoint="tcp/127.0.0.1:7447")
RECORD: dict[str, Any] = {"operation": "0123456789abcdef", "who": "ann"}
_JSON = st.recursive(st.none() | st.booleans() | st.integers() | st.text(), st.lists)
GOOD: dict[str, Any] = {"operation": "0123456789abcdef", "secret": "0" * 32, "watched": True, "logs": ["a.mcap"]}


def parsed(**more: Any) -> PlayRequest:
    return parse_request(PlayRequest, json.dumps({**GOOD, **more}).encode())


def test_a_request_becomes_options_of_the_player() -> None:
    request = parsed(rate=2, topics=["/odom"], clock=40, paused=True, remap=["/a:=/b"], seed=3, until="5")
    options = request.options(AGENT, [Path("/logs/a.mcap")], Path("/plan.toml"))
    assert options == PlayOptions(
        logs=[Path("/logs/a.mcap")], endpoint=AGENT.endpoint, name="r7", rate=2.0, topics=["/odom"], clock=40.0,
        paused=True, remap=["/a:=/b"], seed=3, until="5", inject=Path("/plan.toml"), limits=tight_limits(),
    )  # fmt: skip
    assert (request.on_lost_controller, request.grace) == ("stop", 10.0)


def test_code_and_files_cannot_be_asked_for() -> None:
    never = {"interceptors", "definitions", "endpoint", "config", "name", "control"}
    assert never <= {each.name for each in fields(PlayOptions)}
    assert not never & set(PlayRequest.model_fields)
    for name in never:
        with pytest.raises(ConfigError, match=f"unknown argument '{name}'"):
            parsed(**{name: "x"})


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"logs": []}, "logs: "),
        ({"logs": ["a"] * 17}, "logs: "),
        ({"logs": "a.mcap"}, "logs: "),
        ({"logs": ["x" * 1001]}, "logs.0: "),
        ({"operation": "x; y"}, "operation: "),
        ({"secret": "*"}, "secret: "),
        ({"watched": False}, "needs one that stays"),
        ({"secret": None}, "needs a secret"),
        ({"on_lost_controller": "panic"}, "on_lost_controller: "),
        ({"grace": -1}, "grace: "),
        ({"rate": float("nan")}, "rate: "),
        ({"rate": True}, "rate: "),
        ({"who": "x" * 201}, "who: "),
        ({"seed": 1 << 64}, "seed: "),
        ({"domain": 233}, "domain: "),
    ],
)
def test_what_is_refused(more: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parsed(**more)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"duration": 1.0, "until": "5"}, "both say where to end"),
        ({"remap": ["nonsense"]}, "does not say what to rename"),
        ({"remap": ["/a:=@/zid/router/config"]}, "is not published from afar"),
        ({"remap": ["/a/**:=x/@riot/**"]}, "is not published from afar"),
    ],
)
def test_options_that_the_player_refuses_are_refused_at_once(more: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parsed(**more).options(AGENT, [Path("/logs/a.mcap")], None)


def test_no_file_is_overwritten_from_afar(tmp_path: Path) -> None:
    agent = AgentOptions(robot="r7", folder=tmp_path, endpoint="tcp/127.0.0.1:7447")
    request = parse_request(RecordRequest, json.dumps({**RECORD, "output": "a.mcap"}).encode())
    assert request.options(agent).output == tmp_path.resolve() / "a.mcap"
    (tmp_path / "a.mcap").touch()
    with pytest.raises(ConfigError, match=r"'a\.mcap' exists already\n  hint: choose another name$"):
        request.options(agent)


def test_keys_of_administration_are_none_of_anybodys_business() -> None:
    for key in ("@/x", "a/@x/b", "@riot/r7/agent/progress"):
        with pytest.raises(ConfigError, match="not published from afar"):
            check_key(key, where="remap")
    for key in ("a/b", "0/odom/nav_msgs::msg::dds_::Odometry_/RIHS01_x", "a@b/c", "x/@adv/pub/1"):
        check_key(key, where="remap")


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        ("nonsense", "not a TOML file"),
        ('[[inject]]\ntopic = "x"\nfault = "duplicate"\ncopies = 1001', "too much for a robot"),
        ('[[inject]]\ntopic = "x"\nfault = "delay"\ndelay = 3601', "too much for a robot"),
        ('[[inject]]\ntopic = "x"\nfault = "drop"\n' * 1001, "1001 injections are too many"),
        ('[[inject]]\ntopic = "x"\nfield = "__import__(1)"\nvalue = 1', "is not a field path"),
    ],
)
def test_plans_that_could_wear_down_a_robot(plan: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parsed(inject=plan).check_plan()


def test_plans_within_bounds() -> None:
    parsed(inject='[[inject]]\ntopic = "x"\nfield = "y"\nvalue = 1').check_plan()
    parsed().check_plan()


@given(
    st.binary()
    | st.recursive(st.none() | st.booleans() | st.integers() | st.text(), st.lists).map(json.dumps).map(str.encode)
)
def test_any_bytes_are_a_request_or_refused(payload: bytes) -> None:
    for kind in (Lead, PlayRequest, RecordRequest):
        with pytest.raises(ConfigError):
            parse_request(kind, payload)


@pytest.mark.parametrize("policy", ["stop", "pause"])
def test_a_controller_counts_as_lost_after_the_grace_time(policy: Policy) -> None:
    watch = ControllerWatch(policy, 10.0, 100.0)
    assert watch.look(109.9, present=False) is None
    assert watch.away(109.9) == pytest.approx(9.9)
    assert watch.look(110.0, present=False) == policy
    assert watch.look(111.0, present=False) is None


def test_a_short_break_is_no_loss() -> None:
    watch = ControllerWatch("stop", 10.0, 0.0)
    for start in range(0, 100, 10):
        assert watch.look(start + 9.0, present=False) is None
        assert watch.look(start + 10.0, present=True) is None
    assert watch.away(100.0) == 0.0


def test_after_a_pause_it_is_resumed_when_the_controller_is_back() -> None:
    watch = ControllerWatch("pause", 1.0, 0.0)
    assert watch.look(2.0, present=False) == "pause"
    assert watch.look(3.0, present=True) == "resume"
    assert watch.look(3.5, present=True) is None
    assert watch.look(4.5, present=False) == "pause"


def test_without_grace_the_first_look_decides() -> None:
    assert ControllerWatch("stop", 0.0, 5.0).look(5.0, present=False) == "stop"


@given(
    st.sampled_from(["continue", "pause", "stop"]),
    st.floats(0, 10),
    st.lists(st.tuples(st.floats(0, 10), st.booleans())),
)
def test_nothing_is_done_twice_nor_without_the_controller_being_away(
    policy: Policy, grace: float, looks: list[tuple[float, bool]]
) -> None:
    watch, now, seen, acted = ControllerWatch(policy, grace, 0.0), 0.0, 0.0, False
    for pause, present in looks:
        now += pause
        action = watch.look(now, present=present)
        if present:
            assert action == ("resume" if acted and policy == "pause" else None)
            seen, acted = now, False
        elif action is not None:
            assert (action, acted) == (policy, False)
            assert now - seen >= grace
            acted = True
        if policy == "continue":
            assert action is None
