"""Conformance tests for monitors, for their authors to inherit, and sample trials for them.

    class TestMine(MonitorConformance):
        table = {"kind": "mine", "topic": "odom"}
        passing = [("odom", {"speed": 1.0})]
        failing = [("odom", {"speed": 99.0})]

Needs pytest: the extra `testing`.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from riot_bus.monitors.catalogue import build_monitor
from riot_bus.monitors.forging import why_cannot_fire
from riot_bus.monitors.model import ComponentView, Forges, ResourceSample, TrialView, judge
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from riot_bus_testkit.plugin import ODD_PAYLOADS, PluginConformance

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.monitors.model import Invariant
    from riot_bus.vocabulary.trial import Violation

_STEP_S = 0.1  # a usual rate, 10 Hz; authors of monitors of times set their own

Output = tuple[str, "Mapping[str, Any] | bytes"]


def trial_view(
    outputs: Sequence[Output],
    *,
    inputs: Sequence[Output] = (),
    step: float = _STEP_S,
    settled: bool = True,
    errors: str = "",
    memory: Sequence[int] = (),
) -> TrialView:
    """Return a monitor's view of a trial with these outputs.

    Args:
        outputs: Key and payload of each message; an object is sent as JSON.
        inputs: Key and payload of each message to the component, at the times of the outputs.
        step: Time between messages, and before the first and after the last, in seconds.
        settled: Whether the components came to rest.
        errors: Output of the component to stderr.
        memory: Memory of the component before the first message and after each, in bytes.
    """
    gap = round(step * 1e9)
    sent, received = (
        [
            Message(gap * number, key, payload if isinstance(payload, bytes) else json.dumps(payload).encode())
            for number, (key, payload) in enumerate(messages, 1)
        ]
        for messages in (inputs, outputs)
    )
    samples = [ResourceSample(gap * number, number, size, 10, 2) for number, size in enumerate(memory)]
    component = ComponentView("unit", None, errors, Path("/"), resources=samples)
    end = gap * (max(len(sent), len(received)) + 1)
    return TrialView([component], settled, 1.0, TypeRegistry(), received, 0, end, inputs=sent)


class MonitorConformance(PluginConformance):
    """Tests of a monitor: it distinguishes failing outputs from passing ones, and its verdicts are deterministic.

    Attributes:
        table: A table of `[[monitors]]` in riot.toml, with `kind`.
        passing: Outputs of a trial that has to pass, each a key and a payload; or a view made by `trial_view`.
        failing: Outputs of a trial that has to fail, in the same form.
        step: Time between messages, in seconds.
    """

    table: ClassVar[Mapping[str, Any]]
    passing: ClassVar[Sequence[Output] | TrialView]
    failing: ClassVar[Sequence[Output] | TrialView]
    step: ClassVar[float] = _STEP_S

    def test_it_tells_failing_from_passing(self) -> None:
        """The passing trial has no violation, and the failing one at least one."""
        assert self._judged(self.passing) == []
        assert self._judged(self.failing) != []

    def usual(self) -> list[Violation]:
        """Return the violations of the failing trial, by a monitor that has judged both trials before."""
        monitor = self._made()
        first = self._judged(self.failing, monitor)
        assert self._judged(self.passing, monitor) == []
        assert self._judged(self.failing, monitor) == first
        return first

    def strange(self) -> list[str]:
        """Judge the passing trial with odd messages of another topic, which change nothing."""
        view = self._view(self.passing)
        odd = [Message(view.begin, "somewhere/else", payload) for payload in ODD_PAYLOADS]
        judged = judge(replace(view, outputs=[*odd, *view.outputs]), [self._made()])
        return [str(each) for each in (*judged.violations, *judged.broken)]

    def test_a_violation_says_what_and_who(self) -> None:
        """A violation has a monitor, a component or topic, and a signature of one line for reports and triage."""
        for violation in self._judged(self.failing):
            assert violation.monitor
            assert violation.component
            assert violation.signature
            assert "\n" not in violation.signature

    def test_it_names_the_topics_that_it_looks_at(self) -> None:
        """It names its topics, otherwise they are not recorded; a monitor of components alone names none."""
        topics = self._made().topics
        registry = TypeRegistry()
        seen = [message.key for message in self._view(self.failing).outputs]
        assert not seen or any(registry.matches(topic, key) for topic in topics for key in seen)

    def test_a_trial_without_outputs_is_survived(self) -> None:
        """A trial without outputs has a violation, or the monitor reports that it had nothing to judge."""
        monitor = self._made()
        judged = judge(trial_view([], step=self.step), [monitor])
        assert judged.broken == ()
        assert judged.violations or judged.unseen

    def test_what_passes_is_something_to_judge(self) -> None:
        """The passing trial passes because nothing is wrong, not because there was nothing to judge."""
        assert judge(self._view(self.passing), [self._made()]).unseen == ()

    def test_it_is_shown_to_be_able_to_fire(self) -> None:
        """Its method `forge`, if any, turns a passing trial into a failing one without modifying the original."""
        monitor = self._made()
        if isinstance(monitor, Forges):
            view = self._view(self.passing)
            assert why_cannot_fire(monitor, view) is None
            assert judge(view, [monitor]).violations == ()

    def _made(self) -> Invariant:
        return build_monitor(self.table, where=lambda key: f"table.{key}", root=Path.cwd())

    def _view(self, sample: Sequence[Output] | TrialView) -> TrialView:
        return sample if isinstance(sample, TrialView) else trial_view(sample, step=self.step)

    def _judged(self, sample: Sequence[Output] | TrialView, monitor: Invariant | None = None) -> list[Violation]:
        judged = judge(self._view(sample), [monitor or self._made()])
        assert judged.broken == (), "a monitor that raises judges nothing"
        return list(judged.violations)
