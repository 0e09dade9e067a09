"""A router's graph is taken only if it describes a look after our own recorder has left."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.config.router_settings import RouterSettings
from riot_bus.control.router_flags import RouterOptions
from riot_bus.control.router_options import merged
from riot_bus.control.router_service import RouterService
from riot_bus.draft.init_options import InitOptions
from riot_bus.draft.network import look_at_network
from riot_bus.record.service import CaptureService
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import wait_until

if TYPE_CHECKING:
    from pathlib import Path

    import pytest


def test_a_graph_in_which_our_recorder_receives_everything_is_not_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flags = RouterOptions(segments=["a=tcp/127.0.0.1:0", "b=tcp/127.0.0.1:0"], intercept=["**"])
    with RouterService(merged(RouterSettings(), flags), scouting=None, folder=tmp_path) as router:
        monkeypatch.setattr("riot_bus.graph.watch._LEAST_S", 4.0)  # as on a busy machine: graphs are seldom new
        router.watch()
        endpoint = router.endpoints["a"][0]
        wait = CaptureService.wait

        def after_a_look(service: CaptureService) -> Any:
            watch = router._watches._graph
            assert wait_until(lambda: _received(watch.refresh()) == {"in", "out"}, 10)
            return wait(service)

        monkeypatch.setattr(CaptureService, "wait", after_a_look)
        with open_client(endpoint) as unit, open_client(router.endpoints["b"][0]) as world:
            keep = unit.session.declare_subscriber("in", lambda sample: unit.session.put("out", b"1"))
            assert wait_until(lambda: world.session.put("in", b"1") or len(router.bus.counts()) == 2, 10)
            facts = look_at_network(InitOptions(endpoint=endpoint, seconds=2))
            del keep
    received = {edge.topic for edge in facts.graph.edges if edge.role == "subscribes"}
    assert (received, facts.listener) == ({"in"}, False)


def _received(graph: Any) -> set[str]:
    return {edge.topic for edge in graph.edges if edge.role == "subscribes" and edge.segment == "a"}
