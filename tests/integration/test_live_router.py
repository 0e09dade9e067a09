from __future__ import annotations

import json
import sys
from collections.abc import Iterator

import psutil
import pytest

from riot_bus.testing.live_router import LiveRouter
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.zenoh.session import prepare_runtime

pytestmark = pytest.mark.integration

LASTS = "import threading; threading.Event().wait()"


@pytest.fixture(scope="module")
def router() -> Iterator[LiveRouter]:
    with LiveRouter(["a", "b"], registry=TypeRegistry()) as one:
        yield one


def test_a_router_is_reached_as_its_variables_say(router: LiveRouter, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ZENOH_RUNTIME", raising=False)
    prepare_runtime()  # as for the routers of this process
    unit = router.segment("b")
    settings = json.loads(unit.config_file.read_text())
    assert settings["connect"]["endpoints"] == [unit.endpoint]
    assert unit.environment["ZENOH_CONFIG"] == str(unit.config_file)
    assert "ZENOH_RUNTIME" not in unit.environment
    with pytest.raises(ConfigError, match="no segment 'c'"):
        router.segment("c")


def test_one_segment_is_none() -> None:
    with pytest.raises(ConfigError, match="fewer than two segments: a"):
        LiveRouter(["a", "a"], registry=TypeRegistry())


def test_a_process_is_in_the_last_segment_unless_somebody_says_otherwise(router: LiveRouter, capfd) -> None:
    code = "import os; print(os.environ['RIOT_ENDPOINT'], os.environ['EXTRA'])"
    for segment, name in ((None, "b"), ("a", "a")):
        with router.start([sys.executable, "-c", code], segment=segment, env={"EXTRA": name}) as one:
            assert one.wait(30) == 0
        assert capfd.readouterr().out.split() == [router.segment(name).endpoint, name]


def test_a_process_ends_with_its_block_and_all_that_it_has_started(router: LiveRouter) -> None:
    code = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {LASTS!r}])"
    with router.start([sys.executable, "-c", code]) as one:
        assert one.status is None
        parent = psutil.Process(one.pid)
        while not (children := parent.children()):
            assert one.wait(0.05) is None
    assert not any(process.is_running() for process in (parent, *children))


def test_a_command_that_is_not_there_is_told(router: LiveRouter) -> None:
    with pytest.raises(EnvironmentFaultError, match="does not start"), router.start(["/no/such/program"]):
        pass
