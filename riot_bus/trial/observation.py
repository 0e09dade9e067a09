"""Observation of the running components of one trial: activity, rest, stacks and resources."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Unpack

from riot_bus.processes.activity import STILL, Activity, Idle, Threads, families, idle_between, resources
from riot_bus.system.system_file import Settle
from riot_bus.trial.settling import OWN, POLL, RestOptions, all_wait, is_at_rest, wait_settled

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from riot_bus.monitors.model import ResourceSample
    from riot_bus.processes.python_report import MainEnd, ThreadStack
    from riot_bus.trial.network import TrialNetwork
    from riot_bus.trial.processes import TrialProcesses

MEASURE_S = 0.15
"""Longer than 0.1 s, after which each of Zenoh's threads for callbacks in Python wakes up."""
_MEASURED = 3
"""Number of measurements for components that are started in the same way."""
_FEW = 2
"""Switches by which two measurements of the same timers differ: one falls into the one or into the other, and one of
Zenoh's ten a second."""
_WATCH, _WINDOWS = 0.5, 3
"""Seconds in which a timer that matters comes once, and how often it is looked for: a start may leave something to do
in the first of them, Zenoh's sign of life (5 to 8 switches each 2.5 s) falls into one."""


class Observation:
    """What components do, and when they rest.

    Attributes:
        idle: Activity of components that are ready and never rest; no activity if they rest.
        others: All threads of this process except the one that runs the trial.
    """

    def __init__(self, processes: TrialProcesses, network: TrialNetwork) -> None:
        self.idle = STILL
        self.senders, self.others = OWN.senders, OWN.others
        self._processes, self._network = processes, network
        self._families: dict[tuple[int, ...], Threads] = {}
        self._samples: dict[str, list[ResourceSample]] = {}

    def close(self) -> None:
        """Close all files."""
        for threads in self._families.values():
            threads.close()

    def restart(self) -> None:
        """Discard the noted resources."""
        self._samples = {}

    def threads(self, names: Iterable[str]) -> Threads:
        """Return the threads of components and of what they had started when they were last waited for."""
        pids = self._processes.roots(names)
        if pids not in self._families:
            self._families[pids] = Threads(families(pids))
        return self._families[pids]

    def include_started(self, names: Iterable[str]) -> bool:
        """Include processes that components have started meanwhile; return whether there are no changes."""
        pids = self._processes.roots(names)
        known = self._families.get(pids)
        if known is not None and known.has_all_of(pids):
            return True
        now = families(pids)
        if known is not None and set(known.pids) == set(now):
            return True
        if known is not None:
            known.close()
        self._families[pids] = Threads(now)
        return False

    def activity(self, names: Iterable[str]) -> Activity:
        """Return how busy components have been so far."""
        return self.threads(names).activity()

    def begin(self, names: Iterable[str]) -> tuple[Activity, Activity]:
        """Return the activity so far of components, and of the router here."""
        return self.activity(names), self.others.activity()

    def held_up(self, names: Iterable[str], *, since: tuple[Activity, Activity] | None = None) -> Callable[[], float]:
        """Return a function that tells how many seconds components, or the router here, waited for a processor."""
        looked_at = self.threads(names), self.others
        before = since or [threads.activity() for threads in looked_at]
        return lambda: max(now.activity().waited_since(then) for now, then in zip(looked_at, before, strict=True))

    def wants_processor(self, names: Iterable[str]) -> bool:
        """Return whether components, or the router here, run or would if they had a processor."""
        return self.threads(names).busy() or self.others.busy()

    def measure_idle(self, names: Sequence[str], *, seconds: float) -> Idle:
        """Measure the activity of components for some seconds."""
        begin, before = time.monotonic(), self.activity(names)
        time.sleep(seconds)
        return idle_between(before, self.activity(names), seconds=time.monotonic() - begin)

    def measure_timers(self, names: Sequence[str]) -> Idle:
        """Return what ready components do because of timers of their own; nothing once there is nothing for a while."""
        found: list[Idle] = []
        while len(found) < _WINDOWS and all(each.switches for each in found):
            found.append(self.measure_idle(names, seconds=_WATCH))
        return min(found, key=lambda each: each.switches)

    def settle(self, names: Sequence[str], *, timeout: float, **options: Unpack[RestOptions]) -> bool:
        """Wait until components stand still or one has died, as `wait_settled` does; False if they stay busy.

        Raises:
            EnvironmentFaultError: The machine was too busy for them.
        """
        deadline = time.monotonic() + timeout
        while True:
            self.include_started(names)
            settled = wait_settled(
                self.threads(names),
                timeout=max(0.0, deadline - time.monotonic()),
                alive=lambda: self._processes.alive(names),
                **options,
            )
            if not settled or self.include_started(names):  # else they may still be starting others
                return settled

    def come_to_rest(self, names: Sequence[str], known: list[Idle], *, deadline: float) -> None:
        """Wait until components do next to nothing, or as much as the moment before because of their own timers.

        Their activity then is `idle`, by which work is recognised later. It is measured for longer than after the last
        input; else a pause between two timers would be taken for rest, and no pause as long might come at the end.
        Nor may a thread of the router wait for a processor: it may have a subscription to process that the component
        has declared, and of several subscribers of a key, only the first one is waited for elsewhere.

        Args:
            known: Earlier measurements of components that were started in the same way. With three of them, these only
                have to stand still as after an input; else the new one is added.
        """
        if len(known) >= _MEASURED:
            self.idle = sorted(known, key=lambda each: each.switches)[_MEASURED // 2]
            while (left := deadline - time.monotonic()) > 0:
                if self.settle(
                    names, window=Settle().window, timeout=left, idle=self.idle
                ) and not self.wants_processor(names):
                    return
        last = STILL
        while time.monotonic() < deadline:
            self.include_started(names)
            now = self.measure_idle(names, seconds=MEASURE_S)
            # What a start leaves to do gets less from one measurement to the next.
            alike = abs(now.switches - last.switches) <= 0.2 * now.switches + _FEW / MEASURE_S
            self.idle = now.or_more(last) if alike else now
            # A program that imports takes most of a processor and switches rarely; Zenoh takes a tenth of this share.
            if alike and (now.ran <= 0.03 or last is not STILL) and not self.wants_processor(names):
                known.append(self.idle)
                return
            last = now

    def linger(self, names: Sequence[str], *, seconds: float, timeout: float) -> None:
        """Give components that are at rest time to die.

        A process that ends with an exception is quiet while its session closes (100 ms and more were seen, with a full
        queue), and looks the same from outside as one that has nothing to do. Of Python programs it is known.
        """
        processes = self._processes
        if all(processes.python.goes_on(processes.started[name].pid) for name in names):
            return
        begin, held_up = time.monotonic(), self.held_up(names)
        while processes.alive(names) and time.monotonic() - begin - held_up() < seconds:
            time.sleep(POLL)
        if not any(map(self._network.connected, set(map(self._network.segment_of, names)))):
            processes.wait(names, timeout=timeout)  # all have closed their sessions, so they are ending

    def is_at_rest(self, name: str, *, since: tuple[Activity, Activity], window: float) -> bool:
        """Return whether a component certainly does nothing more without input, and all its outputs have arrived.

        True for Python programs only: any other program that is ending is quiet, too, while it closes its session.

        Args:
            since: Result of `begin` before its input; the threads here send and receive.
        """
        threads, (before, own) = self.threads([name]), since
        return (
            len(threads.pids) == 1
            and is_at_rest(threads, since=before, window=window)
            and all_wait(self.others, since=own, window=window)
            and self._network.bus.idle()
            and self._processes.python.goes_on(self._processes.started[name].pid)
        )

    def sample_resources(self, name: str) -> Sequence[ResourceSample]:
        """Note the resources that a component uses now; return all that were noted."""
        bridge = self._processes.bridges.get(name)
        ours = families([bridge.pid]) if bridge is not None else ()
        own = [pid for pid in self.threads([name]).pids if pid not in ours]
        samples = self._samples.setdefault(name, [])
        samples.append(resources(own, messages=len(self._network.inputs)))
        return samples

    def samples(self, name: str) -> Sequence[ResourceSample]:
        """Return the noted resources of a component over time."""
        return self._samples.get(name, ())

    def stacks(self, name: str) -> list[ThreadStack]:
        """Ask a Python component where its threads stand; empty for others."""
        return self._processes.python.stacks(self.threads([name]).pids)

    def main_end(self, name: str) -> MainEnd | None:
        """Return how the main thread of a Python component has ended; None if it has not, or for other programs."""
        return self._processes.python.main_end(self.threads([name]).pids)
