"""The view that monitors judge, of parts that are written down."""

from __future__ import annotations

import signal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.trial.setup import TrialSetup
from riot_bus.vocabulary.errors import EnvironmentFaultError


def setup(*, status: int | None = None, attach: str | None = None, reasons: dict[str, int] | None = None) -> TrialSetup:
    """Return a setup with one component, whose process has this status, and whose link has stalled."""
    made: Any = TrialSetup.__new__(TrialSetup)
    process = SimpleNamespace(
        status=status, excess=None, stack=(), unread=0, errors=lambda: "err", printed=lambda: "out"
    )
    component = SimpleNamespace(tracebacks="fail", attach=attach)
    made.context = SimpleNamespace(file=SimpleNamespace(components={"part": component}), registry=None)
    made.processes = SimpleNamespace(
        started={"part": process},
        alive=lambda names: status is None,
        check_way=lambda name: None,
        folder_of=lambda name: Path("code"),
        excess=lambda name: None,
    )
    made.observation = SimpleNamespace(samples=lambda name: ())
    losses = SimpleNamespace(reasons=reasons or {}, links=[SimpleNamespace(segment="inner", reason="stalled")])
    made.network = SimpleNamespace(
        bus=SimpleNamespace(losses=losses), inputs=[], outputs=[], now=lambda: 9, segment_of=lambda name: "inner"
    )
    made._begin, made._killed = 3, 0
    return made  # type: ignore[no-any-return]


def test_a_view_has_what_components_printed_and_which_links_stalled() -> None:
    view = setup(status=1).view(["part"], settled=True, waited=2.0)
    (component,) = view.components
    assert (component.status, component.errors, component.printed) == (1, "err", "out")
    assert (view.begin, view.end, view.stalled, view.settled) == (3, 9, ["part"], True)


def test_outputs_that_came_too_fast_are_no_verdict_unless_they_never_end() -> None:
    late = setup(reasons={"observer too slow": 5})
    with pytest.raises(EnvironmentFaultError, match="5 outputs came faster"):
        late.view(["part"], settled=True, waited=2.0)
    assert not late.view(["part"], settled=False, waited=2.0).settled


def test_what_the_kernel_has_killed_for_memory_is_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("riot_bus.trial.setup.out_of_memory_kills", lambda: 1)
    with pytest.raises(EnvironmentFaultError, match="no memory left"):
        setup(status=-signal.SIGKILL).component_view("part")


def test_the_status_of_a_process_that_riot_did_not_start_is_not_known() -> None:
    assert setup(status=0, attach="tcp/1:1").component_view("part").signs.ended == "its process has ended"
    assert not setup(attach="tcp/1:1").component_view("part").signs.ended
