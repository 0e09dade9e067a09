from __future__ import annotations

import json
import os
import warnings
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.zenoh import session as module
from riot_bus.zenoh.session import (
    canonical,
    environment_of_others,
    includes,
    intersects,
    listening,
    open_session,
    prepare_runtime,
    release,
)

RUNTIME = "ZENOH_RUNTIME"


class ZError(Exception):
    pass


def library(problem: str = "", refused: str = "") -> Any:
    """Return a library whose sessions cannot be opened, or which refuses a key."""
    values: dict[str, Any] = {}

    def insert(key: str, text: str) -> None:
        if key == refused:
            raise ZError("unknown key at /home/zenoh/src/lib.rs:7.")
        values[key] = json.loads(text)

    def open_(settings: Any) -> Any:
        if problem:
            raise ZError(problem)
        return values

    config = SimpleNamespace(insert_json5=insert)
    return SimpleNamespace(ZError=ZError, Config=lambda: config, open=open_, try_init_log_from_env=lambda: None)


def error_of(problem: str, **config: Any) -> EnvironmentFaultError:
    keys = {f"{name}/endpoints": value for name, value in config.items()}
    with pytest.raises(EnvironmentFaultError) as error:
        open_session(keys, purpose="segment 'unit'", library=library(problem))
    assert error.value.where == "segment 'unit'"
    return error.value


def test_values_arrive_as_they_are() -> None:
    config = {"mode": "router", "listen/endpoints": ['tcp/"x"'], "adminspace/enabled": True}
    opened: object = open_session(config, purpose="", library=library())
    assert opened == config


def test_a_refused_key_is_told_without_places_in_zenohs_source() -> None:
    with pytest.raises(ConfigError) as error:
        open_session({"mode": "x"}, purpose="segment 'unit'", library=library(refused="mode"))
    assert (error.value.message, error.value.where) == ('Zenoh refuses "x": unknown key', "segment 'unit': mode")


def test_an_endpoint_in_use_is_named() -> None:
    listen = ["tcp/127.0.0.1:1", "tcp/127.0.0.1:2"]
    problem = "Can not create a new TCP listener bound to tcp/127.0.0.1:2: Address already in use"
    assert error_of(problem, listen=listen).message == "tcp/127.0.0.1:2 is in use"
    assert error_of("Address in use", listen=listen).message == "tcp/127.0.0.1:1, tcp/127.0.0.1:2 is in use"


def test_who_does_not_answer_is_named() -> None:
    assert error_of("Unable to connect to any", connect=["tcp/x:1"]).message == "nobody answers at tcp/x:1"
    other = error_of("no such thing at /src/a.rs:1", listen=["tcp/x:1"]).message
    assert other == "Zenoh does not open tcp/x:1: no such thing"


def test_expressions_are_made_canonical_and_each_is_there_once() -> None:
    assert canonical(["a/**/**", "a/**", "b/**/*", "c"]) == ["a/**", "b/*/**", "c"]
    with pytest.raises(ConfigError, match="'a//b' is not a key expression"):
        canonical(["a//b"])
    with pytest.raises(ConfigError) as error:
        canonical(["/chatter"])
    assert "ROS 2" in str(error.value.hint)


@pytest.mark.parametrize(
    ("one", "other", "all_of_it", "some"),
    [("a/**", "a/b", True, True), ("a/b", "a/**", False, True), ("a/*", "*/b", False, True), ("a", "b", False, False)],
)
def test_relations_of_expressions(one: str, other: str, *, all_of_it: bool, some: bool) -> None:
    assert (includes(one, other), intersects(one, other)) == (all_of_it, some)


def test_where_a_session_listens_is_what_it_says_of_itself() -> None:
    payload = SimpleNamespace(to_bytes=lambda: b'{"locators": ["tcp/x:1"]}')
    replies = [SimpleNamespace(ok=None), SimpleNamespace(ok=SimpleNamespace(payload=payload))]
    said: Any = SimpleNamespace(info=SimpleNamespace(zid=lambda: "abc"), get=lambda selector, timeout: replies)
    assert listening(said) == ["tcp/x:1"]
    del replies[1]
    assert listening(said) == []


def test_sessions_are_closed_and_all_else_undeclared() -> None:
    steps: list[str] = []
    both = SimpleNamespace(close=lambda: steps.append("close"), undeclare=lambda: steps.append("no"))
    release(both, SimpleNamespace(undeclare=lambda: steps.append("undeclare")))
    assert steps == ["close", "undeclare"]


def test_our_threads_are_not_those_of_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(RUNTIME, "")  # so that it is put back
    monkeypatch.delenv(RUNTIME)
    monkeypatch.setattr(module, "_OURS", set(module._OURS))
    prepare_runtime(17)
    assert "worker_threads: 17" in os.environ[RUNTIME]
    assert RUNTIME not in environment_of_others()
    prepare_runtime(99)
    assert "worker_threads: 17" in os.environ[RUNTIME]


@pytest.mark.parametrize(
    ("value", "few"),
    [
        ("(rx: (worker_threads: 3))", True),
        ("(tx: (worker_threads: 9))", True),  # Zenoh's default is 2
        ("(rx: (max_blocking_threads: 1, worker_threads: 8), tx: (worker_threads: 1))", False),
    ],
)
def test_a_users_own_setting_is_kept_and_few_threads_are_warned_of(
    monkeypatch: pytest.MonkeyPatch, value: str, *, few: bool
) -> None:
    monkeypatch.setenv(RUNTIME, value)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        prepare_runtime()
    assert bool(warned) is few
    assert environment_of_others()[RUNTIME] == os.environ[RUNTIME] == value
