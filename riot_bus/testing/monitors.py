"""A bench for monitors, and what every monitor has to hold, as tests to inherit.

    class TestMine(MonitorConformance):
        table = {"kind": "mine", "topic": "odom"}
        passing = [("odom", {"speed": 1.0})]
        failing = [("odom", {"speed": 99.0})]

Needs pytest: pip install 'riot-bus[testing]'.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from riot_bus.monitors.catalogue import build_monitor
from riot_bus.monitors.model import ComponentView, TrialView, judge
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.monitors.model import Invariant
    from riot_bus.vocabulary.trial import Violation

__all__ = ["MonitorConformance", "trial_view"]

_STEP_S = 0.1
_STRANGE = (b"", b"\x00" * 64, b"{", b"\xff\xfe\xfd")

Output = tuple[str, "Mapping[str, Any] | bytes"]


def trial_view(outputs: Sequence[Output], *, step: float = _STEP_S, settled: bool = True) -> TrialView:
    """Return what a monitor sees of a trial with these outputs.

    Args:
        outputs: Key and payload of each message; an object is sent as JSON.
        step: Time from one message to the next, and before the first and after the last, seconds.
        settled: Whether the components came to rest.
    """
    gap = round(step * 1e9)
    messages = [
        Message(gap * number, key, payload if isinstance(payload, bytes) else json.dumps(payload).encode())
        for number, (key, payload) in enumerate(outputs, 1)
    ]
    component = ComponentView("unit", None, "", Path("/"))
    return TrialView([component], settled, 1.0, TypeRegistry(), messages, 0, gap * (len(messages) + 1))


class MonitorConformance:
    """What holds for a monitor: it tells failing outputs from passing ones, and always in the same words.

    Attributes:
        table: A table of `[[monitors]]` in riot.toml, with `kind`.
        passing: Outputs of a trial that is to pass: key and payload each.
        failing: Outputs of a trial that is to fail.
        step: Time from one message to the next, seconds.
    """

    table: ClassVar[Mapping[str, Any]]
    passing: ClassVar[Sequence[Output]]
    failing: ClassVar[Sequence[Output]]
    step: ClassVar[float] = _STEP_S

    def test_it_tells_failing_from_passing(self) -> None:
        """No violation of what passes, and one at least of what fails."""
        assert self._judged(self.passing) == []
        assert self._judged(self.failing) != []

    def test_it_repeats_itself(self) -> None:
        """It keeps nothing from one trial to the next, and the same failure has the same signature."""
        monitor = self._made()
        first = self._judged(self.failing, monitor)
        assert self._judged(self.passing, monitor) == []
        assert self._judged(self.failing, monitor) == first == self._judged(self.failing)

    def test_a_violation_says_what_and_who(self) -> None:
        """Reports and triage need a monitor, a component or topic, and a signature without the values of this trial."""
        for violation in self._judged(self.failing):
            assert violation.monitor
            assert violation.component
            assert violation.signature
            assert "\n" not in violation.signature

    def test_it_names_the_topics_that_it_looks_at(self) -> None:
        """Else nobody records them for it, and it sees nothing."""
        topics = self._made().topics
        assert topics
        registry = TypeRegistry()
        seen = [key for key, _ in self.failing]
        assert not seen or any(registry.matches(topic, key) for topic in topics for key in seen)

    def test_a_trial_without_outputs_is_survived(self) -> None:
        """A unit that said nothing is judged, too."""
        assert judge(trial_view([], step=self.step), [self._made()]).broken == ()

    def test_other_topics_and_strange_payloads_are_not_its_fault(self) -> None:
        """Messages that it does not look at change nothing, whatever they hold."""
        strange = [("somewhere/else", payload) for payload in _STRANGE]
        assert self._judged([*strange, *self.passing], step=self.step * 1e-3) == []

    def _made(self) -> Invariant:
        return build_monitor(self.table, where=lambda key: f"table.{key}", root=Path.cwd())

    def _judged(
        self, outputs: Sequence[Output], monitor: Invariant | None = None, *, step: float | None = None
    ) -> list[Violation]:
        view = trial_view(outputs, step=self.step if step is None else step)
        found = judge(view, [monitor or self._made()])
        assert found.broken == (), "a monitor that raises judges nothing"
        return list(found.violations)
