"""Crash and hang: the monitors that are always on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.monitors.signature import crash_in
from riot_bus.vocabulary.trial import Violation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.monitors.model import TrialView

__all__ = ["CrashMonitor", "HangMonitor"]


class CrashMonitor:
    """A component died of a signal, ended with a non-zero status, or wrote a traceback and stayed asleep.

    The last case is real: a Python component whose main thread dies does not exit while its Zenoh session is open.
    """

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return one violation per crashed component."""
        found = []
        for component in view.components:
            if component.status is None and not component.tracebacks:
                continue
            crash = crash_in(component.status, component.errors, component.root)
            if crash is not None:
                signature = f"crash in {component.name}: {crash.place}"
                found.append(Violation("crash", component.name, signature, crash.detail))
        return found


class HangMonitor:
    """A component never came to rest after its last input, or stopped taking messages from its link."""

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return one violation per component that hangs."""
        found = []
        for component in view.components:
            if component.status is not None:
                continue
            if component.name in view.stalled:
                detail = "it stopped taking messages from its link"
                found.append(Violation("hang", component.name, f"hang of {component.name}", detail))
            elif not view.settled:
                detail = f"still busy {view.waited:g} s after its last input"
                found.append(Violation("hang", component.name, f"hang of {component.name}", detail))
        return found
