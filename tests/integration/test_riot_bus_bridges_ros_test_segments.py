"""What processes get that shall use a router, and who has come."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from riot_bus.config.router_settings import RouterSettings, SegmentSettings
from riot_bus.control.router_service import RouterService
from riot_bus.processes.launcher import Launcher
from riot_bus_bridges.ros_test.segments import HERE, UNIT, Components, open_segments
from tests.integration.zenoh_process import ZenohProcess

pytestmark = pytest.mark.integration


@pytest.fixture
def service() -> Iterator[RouterService]:
    with RouterService(RouterSettings(segments={HERE: SegmentSettings(), UNIT: SegmentSettings()})) as one:
        yield one


def test_the_command_is_in_one_segment_and_what_is_chosen_in_the_other(service: RouterService, tmp_path: Path) -> None:
    with Launcher() as launcher, open_segments(service, launcher, tmp_path, nodes="planner", dds=False) as segments:
        environment = segments.environment
        plan = json.loads(Path(environment["RIOT_PLACEMENT"]).read_text())
        assert (segments.domains, segments.carried, plan["segment"], plan["nodes"]) == ({}, {}, UNIT, "planner")
        for name, variables in {HERE: environment, UNIT: plan["variables"]}.items():
            assert variables["RIOT_ENDPOINT"] == service.bus.endpoint(name)
            assert f'connect/endpoints=["{service.bus.endpoint(name)}"]' in variables["ZENOH_CONFIG_OVERRIDE"]
            assert json.loads(Path(variables["ZENOH_CONFIG"]).read_text())["mode"] == "client"


def test_who_was_there_before_is_not_counted(service: RouterService) -> None:
    with ZenohProcess("client", service.bus.endpoint(HERE)):
        components = Components(service)
        components.look()
        assert components.found == {}
        with ZenohProcess("client", service.bus.endpoint(UNIT)), ZenohProcess("client", service.bus.endpoint(UNIT)):
            components.look()
        components.look()
        assert components.found == {UNIT: 2}
