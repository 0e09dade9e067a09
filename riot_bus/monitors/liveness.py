"""Crash, exit, hang, silence, growth and limits: the monitors that are always on."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

from riot_bus.monitors.signature import Crash, crashes_in
from riot_bus.vocabulary.trial import Violation

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from riot_bus.monitors.model import ComponentView, TrialView

_THREAD_ENDED = "a thread has ended"


class _OfComponents:
    """A monitor that judges one component after the other."""

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return the violations of all components."""
        return [each for component in view.components for each in self._violations(component, view)]

    def _violations(self, component: ComponentView, view: TrialView) -> Iterable[Violation]:
        raise NotImplementedError


class CrashMonitor(_OfComponents):
    """A component died of a signal, ended with a non-zero status, or wrote a traceback and stayed asleep.

    The last case is real: a Python component whose main thread dies does not exit while its Zenoh session is open.
    """

    def _violations(self, component: ComponentView, view: TrialView) -> Iterable[Violation]:
        lives = "; the process has not ended" if component.status is None else ""
        for crash in crashes_of(component):
            signature = f"crash in {component.name}: {crash.place}"
            yield Violation("crash", component.name, signature, f"{crash.detail}{lives}")


class ExitMonitor(_OfComponents):
    """A component exited with status 0, or one of its threads ended, which nominal trials do not cause."""

    def _violations(self, component: ComponentView, view: TrialView) -> Iterable[Violation]:
        signs = component.signs
        lost = f"{_THREAD_ENDED}: {', '.join(signs.lost)}" if signs.lost and not signs.blocked else ""
        if (why := signs.ended or lost) and not crashes_of(component):
            yield _violation("exit", component, why)


class HangMonitor(_OfComponents):
    """A component stayed busy after its last input, blocks where it does not at rest, or takes no messages."""

    def _violations(self, component: ComponentView, view: TrialView) -> Iterable[Violation]:
        signs = component.signs
        if component.status is not None or signs.ended or crashes_of(component):
            return
        where = f" in {', '.join(signs.blocked)}" if signs.blocked else ""
        if component.name in view.stalled:
            detail = "it stopped taking messages from its link"
        elif signs.known:
            detail = f"it stands{where} and publishes nothing, as when it was waited for to the end in another trial"
        elif not view.settled:
            detail = f"still busy {view.waited:g} s after its last input"
        elif where:
            detail = f"a thread stands{where}, where none does at rest"
            if signs.silent:
                detail += f"; no more output on {', '.join(signs.silent)}"
        else:
            return
        yield _violation("hang", component, where.strip(), detail)


class SilenceMonitor(_OfComponents):
    """A component is alive, but no nominal input makes it publish some outputs of nominal trials any more."""

    def _violations(self, component: ComponentView, view: TrialView) -> Iterable[Violation]:
        signs, topics = component.signs, ", ".join(component.signs.silent)
        explained = signs.ended or signs.blocked or signs.lost or component.status is not None
        if topics and not explained and not crashes_of(component):
            detail = f"neither the probe brings {topics}, as it does in nominal trials, nor the whole nominal log"
            yield _violation("silent", component, f"nothing on {topics}", detail)


class GrowthMonitor(_OfComponents):
    """A component has much more memory, open files or threads after a trial than after nominal ones."""

    def _violations(self, component: ComponentView, view: TrialView) -> Iterable[Violation]:
        for what, size in component.signs.grown.items() if component.status is None else ():
            yield _violation("growth", component, what, f"{what}: {size}")


class LimitMonitor(_OfComponents):
    """A component was ended for exceeding a limit of memory, files, processes or processor time."""

    def _violations(self, component: ComponentView, view: TrialView) -> Iterable[Violation]:
        if component.excess:
            yield _violation("limit", component, component.excess[0], component.excess[1])


LIVENESS = (CrashMonitor, LimitMonitor, ExitMonitor, HangMonitor, SilenceMonitor, GrowthMonitor)
"""These monitors in order of severity."""


def is_compared(violation: Violation) -> bool:
    """Return whether a violation only states a difference from nominal trials."""
    ended = violation.monitor == "exit" and f": {_THREAD_ENDED}" in violation.signature
    return ended or violation.monitor in ("silent", "growth")


def crashes_of(component: ComponentView) -> tuple[Crash, ...]:
    """Return the crashes of a component; they explain everything else that is wrong with it."""
    if component.excess:
        return ()
    if component.status is None and not component.tracebacks:
        return ()
    return _crashes(component.status, component.errors, component.root, component.printed, tuple(component.stack))


@functools.lru_cache(maxsize=2)
def _crashes(
    status: int | None, errors: str, root: Path, printed: str, stack: tuple[tuple[str, str], ...]
) -> tuple[Crash, ...]:
    """Return the cached result of `crashes_in`, since several monitors need it and the output may be long."""
    return crashes_in(status, errors, root, printed=printed, stack=stack)


def _violation(monitor: str, component: ComponentView, place: str, detail: str = "") -> Violation:
    signature = f"{monitor} of {component.name}" + (f": {place}" if place else "")
    return Violation(monitor, component.name, signature, detail or place)
