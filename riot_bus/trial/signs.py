"""Check that a unit still works after a trial: a probe, its threads and its end are compared with nominal trials."""

from __future__ import annotations

import time
from collections import Counter
from typing import TYPE_CHECKING, Unpack

from riot_bus.log.playback.player import play
from riot_bus.monitors.liveness import crashes_of
from riot_bus.monitors.model import NO_SIGNS, Signs
from riot_bus.processes.python_report import deepest_common
from riot_bus.processes.resource_limits import Guard
from riot_bus.trial.baseline import Baseline, Growth, NominalTrial, growth_of
from riot_bus.trial.hang_watch import LOOKS, HangWatch
from riot_bus.trial.hangs import hang_stacks
from riot_bus.trial.settling import POLL, wait_sent, wait_taken
from riot_bus.vocabulary.clock import SystemClock

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.processes.activity import Activity
    from riot_bus.processes.python_report import ThreadStack
    from riot_bus.system.system_file import Unit
    from riot_bus.trial.settling import RestOptions
    from riot_bus.trial.setup import TrialSetup
    from riot_bus.vocabulary.message import Message

_CHECK_EVERY = 64
_SAMPLES = 16
_TAKEN_S = 2.0
"""A unit that works for longer, or has a thread that never sleeps, gets all further messages without waiting."""
_LATE_STILL, _LATE_TIMERS = 0.25, 2.0
_SPIN_S, _SPIN_SHARE = 0.25, 0.5
"""A thread without an end takes all of a processor that it gets, one that works off its timers some percent."""
_RUNS_OUT_S = 30.0
"""Longest wait for the end of a program that fills memory, without the time in which it has no processor; with that,
four times as long."""
_TAKEN_BYTES, _TAKEN_RUN, _TAKEN_LOOK = 1 << 22, 0.1, 0.5
"""A program that fills memory gets so many bytes in so many seconds in which it runs, a fortieth of what one does that
is alone on its machine; one that sleeps is looked at after so many seconds."""


class Feeder:
    """Plays messages to a running unit, and finds out whether it still works afterwards.

    Args:
        ordered: Whether the order of the log is kept across topics.

    Attributes:
        sent: Number of messages that were published the last time.
        gave_up: Whether the order across topics was to be kept and was not: a unit that works for long, or never
            sleeps, gets further messages without waiting.
        probed: Number of outputs before the last probe; None if there was none.
        begun: Activity of the unit and of the router here before the first input; None before that.
    """

    def __init__(self, setup: TrialSetup, name: str, unit: Unit, baseline: Baseline, *, ordered: bool = False) -> None:
        self.sent = 0
        self.probed: int | None = None
        self._name, self._baseline, self._component_view = name, baseline, setup.component_view
        self._network, self._processes, self._observation = setup.network, setup.processes, setup.observation
        self._segment, self._limits = self._network.segment_of(name), setup.context.file.components[name].limits
        self._settle, self._rate = unit.settle, unit.rate
        self._process, self._registry = self._processes.started[name], setup.context.registry
        self.gave_up = False
        self._ordered = ordered and not unit.rate
        self._fed = time.monotonic()
        self.begun: tuple[Activity, Activity] | None = None
        self._hangs = setup.context.hangs[name]
        self._watch = HangWatch(
            self._hangs, self._network, self._observation, name, baseline, timeout=unit.settle.timeout
        )

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return self._processes.alive([self._name])

    def feed(self, messages: Sequence[Message], *, expected: Mapping[str, int] | None = None) -> bool:
        """Publish messages and wait until the unit has come to rest or died; see `rest`.

        Args:
            messages: Messages to publish.
            expected: Number of outputs by topic after which it has received everything. Without them it has to be still
                for a window: on a loaded machine, the kernel may hold back what was sent for some milliseconds.
        """
        begin, begun = len(self._network.outputs), self._observation.begin([self._name])
        self.begun = self.begun or begun
        before = self._publish(messages, begun[0])

        least = sum(expected.values()) if expected else 0

        def rests() -> bool:
            return (
                len(self._network.outputs) - begin >= least
                and not Counter(expected) - self._answers(begin)
                and self._observation.is_at_rest(self._name, since=begun, window=self._settle.window)
            )

        return self.rest(
            [self._name],
            window=self._settle.window,
            timeout=self._settle.timeout,
            idle=self._baseline.idle,
            since=before if messages else None,
            rests=rests if expected else None,
        )

    def rest(self, names: Sequence[str], *, timeout: float, **options: Unpack[RestOptions]) -> bool:
        """Wait until components, of which the unit is one, have come to rest; see `Observation.settle`.

        Returns:
            False if they were busy to the deadline. That is not waited for where the unit hangs as it did before.
        """
        self._fed = time.monotonic()
        options["hangs"] = self._watch
        settled = self._observation.settle(names, timeout=timeout, **options)
        if settled and self.alive:
            self._watch.went_on()
        return settled

    def feed_case(self, messages: Sequence[Message]) -> bool:
        """Feed the messages of a test case; one with more than the nominal log may have as many answers too early."""
        usual = len(messages) <= len(self._baseline.log)
        return self.feed(messages, expected=self._baseline.log_answers if usual else None)

    def end(self, *, hangs: bool, seconds: float) -> None:
        """Note for later trials how long the unit was busy before it went on, and how long this one took."""
        busy, taken_for = (0.0, None) if hangs else (self._watch.longest, self._watch.taken_for)
        self._hangs.ended(seconds, busy=busy, taken_for=taken_for)

    def _publish(self, messages: Sequence[Message], before: Activity) -> Activity:
        """Publish messages.

        Returns:
            Activity of the unit just before the last message.
        """
        observation, names = self._observation, [self._name]
        self.sent, ordered, batched = 0, self._ordered, not (self._ordered or self._rate)
        samples = max(_CHECK_EVERY, len(messages) // _SAMPLES)
        observation.senders.busy()  # finds them: `wait_taken` looks at known ones
        key, threads = messages[0].key if messages else "", observation.threads(names)
        ran = threads.ran()

        def hopeless() -> bool:
            return self._watch() or not self.alive

        def publish(message: Message) -> None:
            nonlocal before, key, ran, ordered
            if ordered and message.key != key:
                ordered = wait_taken(threads, observation.senders, before=ran, timeout=_TAKEN_S, hopeless=hopeless)
                self.gave_up |= not ordered
                if ordered:
                    self._watch.went_on()
                ran, key = threads.ran(), message.key
            if self.sent and (self.sent % _CHECK_EVERY == 0 or self.sent == len(messages) - 1):
                before = observation.activity(names)
            if self.sent % samples == 0:
                observation.sample_resources(self._name)
            self.sent += 1
            self._network.put(self._segment, message, batched=batched)

        def stop() -> bool:
            return self.sent % _CHECK_EVERY == 0 and not self.alive

        play(messages, publish, rate=self._rate, clock=SystemClock(), stop=stop)
        wait_sent(observation.senders, timeout=self._settle.timeout)
        return before

    def nominal(self, probe: Sequence[Message]) -> NominalTrial:
        """Return the observations of a nominal trial whose log has been played, and play the probe.

        On a loaded machine, the unit may seem at rest before it has its input. So this waits for the answers that the
        baseline knows or, as long as it knows none, for answers on all topics on which the log brought some, and for
        late answers if other processes used the processors meanwhile.
        """
        self._await_late()
        answers, begin = self._answers(0), len(self._network.outputs)
        probed: Mapping[str, int] = {}
        if self.alive:
            self.feed(probe)
            self._linger()
            self._network.bus.drain(self._settle.timeout)
            expected = self._baseline.probe_answers or dict.fromkeys(answers, 1)
            if Counter(expected) - self._answers(begin) and not self._missing(expected, begin):
                self._wait_quiet()
            if not self._baseline.probe_answers:
                self._await_late()
            probed, self.probed = self._answers(begin), begin
        stacks = self._observation.stacks(self._name) if self.alive else []
        ended = self._observation.main_end(self._name) is not None
        return NominalTrial(answers, probed, stacks, ended, self._process.status, self._growth())

    def _await_late(self) -> None:
        """Wait for what is on its way: where others had the processors since the first input, also for late answers."""
        if self.begun is not None and self._observation.held_up([self._name], since=self.begun)() > self._settle.window:
            self._wait_quiet()
        self._network.bus.drain(self._settle.timeout)

    def signs(self, *, settled: bool, unprobed: bool = False) -> tuple[Signs, bool]:
        """Return the differences from nominal trials, and whether the unit has come to rest after all input.

        A unit that answers nominal input as in nominal trials is alive. One that does not gets the whole nominal log,
        since an input may have put it into a state that another one ends, or it still lacks some input. It only has to
        answer on the topics of the probe: nominal trials do not show which answers come only once over two logs.

        Args:
            settled: Whether the unit has come to rest after the log.
            unprobed: Whether it gets no nominal input; then only its process, its end and its growth are judged.
        """
        baseline = self._baseline
        settled = settled or self._runs_out()
        if not settled and (self._watch.known or self._spins()):
            return self._standing(), False
        if unprobed:
            self._await_late()
            self._linger()
            return self._left(), True
        if not self.alive or not baseline.follows:
            if settled:
                self._linger()
            return (self._changed() if settled else self._standing()), settled
        silent: tuple[str, ...] = ()
        again = {topic: baseline.log_answers.get(topic, count) for topic, count in baseline.probe_answers.items()}
        for messages, expected in ((baseline.probe, baseline.probe_answers), (baseline.log, again)):
            begin = len(self._network.outputs)
            if settled:
                settled = self.feed(messages, expected=expected)
            else:
                self._publish(messages, self._observation.activity([self._name]))
            silent = () if self._watch.known else self._missing(expected, begin)
            if self._watch.known:
                return self._standing(), False
            if not settled and (silent or self._spins()):
                return self._standing(), False
            if not silent or not self.alive or self._has_failed():
                break
        if not silent and settled and self.alive and baseline.mined.rules:
            self._compare(begin if messages is baseline.probe else None)
            if self.probed is not None and (silent := self._missing(baseline.probe_answers, self.probed)):
                self.probed = None  # what has come for the nominal log was late: no answer
        if silent:
            self._linger()
            return self._changed(silent), True
        return self._left(), True

    def _left(self) -> Signs:
        """Return the signs of a unit that works, as far as is known: whether it has ended, and what has grown."""
        ended, grown = self._ended(), self._grown()
        return Signs(ended=ended, grown=grown) if ended or grown else NO_SIGNS

    def _compare(self, begin: int | None) -> None:
        """Set `probed`. Where answers differ from nominal ones, the unit gets the nominal log and the probe once more.

        Args:
            begin: Index of the first answer to the probe; None if the whole log came after it.
        """
        outputs, baseline = self._network.outputs, self._baseline
        if begin is not None and not baseline.mined.differs(outputs[begin:], self._registry):
            self.probed = begin
            return
        settled = True
        for messages in (baseline.log, baseline.probe):
            begin = len(outputs)
            settled = settled and self.feed(messages)
            self._wait_quiet()  # late answers to the log are none to the probe
        self.probed = begin if settled and self.alive else None

    def _wait_quiet(self) -> None:
        """Wait until outputs no longer come, or for as long as those of timers may take."""
        self._network.bus.drain(self._settle.timeout)
        held_up, start = self._observation.held_up([self._name]), time.monotonic()
        count, last = len(self._network.outputs), 0.0
        while self.alive and (now := time.monotonic() - start - held_up()) < _LATE_TIMERS:
            if len(self._network.outputs) != count:
                count, last = len(self._network.outputs), now
            elif now - last > _LATE_STILL and not self._observation.wants_processor([self._name]):
                break
            time.sleep(POLL)

    def works(self, trial: NominalTrial) -> bool:
        """Return whether a unit that did not come to rest in a nominal trial still works.

        One with timers of its own may find no rest on a loaded machine; if it answers, and does not run all the time,
        it works.
        """
        return self.alive and bool(trial.probe_answers) and not self._spins()

    def _runs_out(self) -> bool:
        """Wait while a busy unit takes ever more memory, or has too much already; return whether it was ended for that.

        On a loaded machine, memory may grow slowly, and the limit may be enforced late: that is not a hang.
        """
        observation, limits, names = self._observation, self._limits, [self._name]
        if limits == "off" or self._watch.known:
            return False
        held_up, begin, memory = observation.held_up(names), time.monotonic(), 0
        while self.alive and time.monotonic() - begin < min(_RUNS_OUT_S + held_up(), 4 * _RUNS_OUT_S):
            if Guard(self._process.pid, limits.model_dump()).excess():
                return self._processes.wait(names, timeout=_RUNS_OUT_S)
            now = observation.sample_resources(self._name)[-1].memory
            if memory and now - memory < _TAKEN_BYTES:
                break
            memory, before, start = now, observation.activity(names), time.monotonic()
            while self.alive and (seen := observation.activity(names)).ran_since(before) < _TAKEN_RUN:
                if time.monotonic() - start - seen.waited_since(before) > _TAKEN_LOOK:
                    break
                time.sleep(POLL)
        return not self.alive

    def _spins(self) -> bool:
        """Return whether the unit runs so much more than without input that one of its threads must run for ever."""
        ran = self._observation.measure_idle([self._name], seconds=_SPIN_S).ran
        return ran > self._baseline.idle.ran + _SPIN_SHARE

    def _answers(self, begin: int) -> Counter[str]:
        """Return how many outputs there have been since an index of all outputs, by topic."""
        return Counter(self._registry.topic(message.key) for message in self._network.outputs[begin:])

    def _missing(self, expected: Mapping[str, int], begin: int) -> tuple[str, ...]:
        """Wait for outputs on topics; return those on which none came. Timers may need a while to come round.

        Of a unit that has failed already, more need not be known.
        """
        if not expected.keys() - self._answers(begin).keys():
            return ()
        self._network.bus.drain(self._settle.timeout)
        wait = 0.0 if self._has_failed() else _LATE_TIMERS if self._baseline.idle.switches else _LATE_STILL
        held_up, start = self._observation.held_up([self._name]), time.monotonic()
        while (missing := expected.keys() - self._answers(begin).keys()) and self.alive and not self._watch():
            waited = time.monotonic() - start - held_up()
            if waited > _LATE_TIMERS or (waited > wait and not self._observation.wants_processor([self._name])):
                break
            time.sleep(POLL)
        return tuple(sorted(missing))

    def _linger(self) -> None:
        if self.alive:
            self._observation.linger([self._name], seconds=self._settle.linger, timeout=self._settle.timeout)

    def _changed(self, silent: Sequence[str] = ()) -> Signs:
        stacks = self._look() if self.alive else []
        ended, blocked = self._ended(), self._baseline.blocked(stacks, anywhere=bool(silent))
        if silent and blocked and not ended:
            self._hangs.add(hang_stacks(stacks, blocked), waited=time.monotonic() - self._fed)
        return Signs(
            ended,
            silent,
            blocked,
            self._baseline.lost(stacks) if stacks else (),
            self._grown(),
            _text(stacks),
        )

    def _growth(self) -> Growth:
        return growth_of(self._observation.sample_resources(self._name))

    def _grown(self) -> dict[str, str]:
        if not self._baseline.trials or not self.alive:
            return {}
        inputs = self._network.inputs
        size = sum(len(message.payload) for message in inputs)
        return self._baseline.grown(self._growth(), messages=len(inputs), input_bytes=size)

    def _standing(self) -> Signs:
        stacks = self._look()
        blocked = self._baseline.blocked(stacks, anywhere=True)
        if not self._watch.known:
            self._hangs.add(hang_stacks(stacks, blocked), waited=time.monotonic() - self._fed)
        return Signs(blocked=blocked, stacks=_text(stacks), known=self._watch.known)

    def _look(self) -> list[ThreadStack]:
        """Return where threads stand: of a thread that runs, what several looks have in common."""
        looks = []
        for _ in range(LOOKS):
            looks.append(self._observation.stacks(self._name))
            if not looks[0]:
                break
            time.sleep(0.02)  # a thread that runs is elsewhere then
        return deepest_common(looks)

    def _has_failed(self) -> bool:
        """Return whether the unit has crashed or ended for certain, though its process may go on."""
        return bool(crashes_of(self._component_view(self._name)) or self._ended())

    def _ended(self) -> str:
        """Return how the unit has ended although it does not end in nominal trials; empty if it has not ended."""
        if not self.alive:
            if self._process.status != 0 or self._baseline.ends:
                return ""
            call = self._processes.python.exit_call([self._process.pid])
            return f"status 0 by {call.call} in {call.function}" if call and call.call else "status 0"
        if self._baseline.main_ends or not self._baseline.trials:
            return ""
        end = self._observation.main_end(self._name)
        if end is None:
            return ""
        by = f" by {end.call} in {end.function}" if end.call else ""
        return f"the main thread has ended{by}, though the process has not"


def _text(stacks: Sequence[ThreadStack]) -> str:
    return "\n\n".join(stack.text for stack in stacks)
