"""Formulas of signal temporal logic over fields, judged in dense time by the package rtamt (extra `stl`)."""

from __future__ import annotations

import math
import re
import sys
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice, product
from typing import Annotated, Any

from pydantic import Field

from riot_bus.monitors.model import TrialView, why_no_message
from riot_bus.monitors.selection import field_selector, selected, why_unseen
from riot_bus.types.elements import read_field
from riot_bus.vocabulary.errors import ConfigError, MissingExtraError, PayloadError, did_you_mean
from riot_bus.vocabulary.message import Message, Scalar
from riot_bus.vocabulary.trial import Violation

_MOST_CHANGES = 10_000  # of all signals: rtamt's time grows with their number times that of operators
_MOST = sys.float_info.max  # the difference of infinite signals would be NaN
_MOST_AHEAD = 86_400  # a day, as for all other times in riot.toml
_MOST_TRIED = 256  # all choices for two signals and four numbers; each try parses the formula anew
_NUMBER = re.compile(r"(?<![\w.])(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?(?![\w.])")
_OPERATOR = re.compile(
    "not|and|or|implies|iff|xor|always|eventually|until|historically|once|since|[GFUHOS]|abs|sqrt|exp|pow"
)  # no other word gets to rtamt: its language can import modules, and takes 500ms for 500000 s
_OTHER = re.compile(r"[^\s()\[\]:,+*/<>=!&|-]")
_FUTURE = ("Always", "Eventually", "Until")  # names of rtamt's nodes; Timed... with bounds

_Samples = list[list[float]]


@dataclass(frozen=True)
class Stl:
    """A formula of signal temporal logic holds; a signal keeps its value until the next message.

    Judging begins when every signal has a value. An outermost `always` is judged up to the last time whose whole
    look-ahead was watched; any other formula only once, at the beginning.

    Attributes:
        formula: Formula for rtamt, times in seconds: `always ((speed > 0.5) implies (eventually[0:2] (ack >= 1)))`.
        signals: `topic:field` of each signal of the formula, of outputs, or of inputs if no output has the topic.
    """

    formula: Annotated[str, Field(max_length=1000)]
    signals: Annotated[dict[str, str], Field(min_length=1, max_length=16)]

    whole_trial = True

    def __post_init__(self) -> None:
        for name, text in self.signals.items():
            field_selector(text)
            if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII) or _OPERATOR.fullmatch(name):
                raise ConfigError(f"{name!r} cannot name a signal", hint="use a word that is not an operator")
        words = _NUMBER.sub(" ", self.formula)
        for word in re.findall(r"[^\W\d]\w*", words):
            if word not in self.signals and not _OPERATOR.fullmatch(word):
                hint = f"bind it: signals = {{ {word} = 'topic:field' }}; {did_you_mean(word, self.signals)}"
                raise ConfigError(f"formula: unknown signal or operator {word!r}", hint=hint)
        if unused := sorted(set(self.signals) - set(re.findall(r"\w+", words))):
            raise ConfigError(f"signal {unused[0]!r} is not in the formula", hint="remove it, or mend the formula")
        if strange := _OTHER.search(re.sub(r"[^\W\d]\w*", " ", words)):
            hint = "it consists of signals, numbers without units, operators and brackets"
            raise ConfigError(f"formula: {strange[0]!r} is not understood", hint=hint)
        if "!=" in self.formula:  # its robustness is never negative
            hint = "write '(x < 0.5) or (x > 1.5)' instead of 'x != 1'"
            raise ConfigError("formula: '!=' can never be violated by more than nothing", hint=hint)
        _ahead(_Parsed(self).node)

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics of all signals."""
        return tuple(dict.fromkeys(field_selector(text).topic for text in self.signals.values()))

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation if the formula does not hold, with the first time at which it does not."""
        samples, end = self._samples(view)
        if self._why_short(samples, end) is not None:
            return []
        found = self._first_false(samples, end)
        if found is None or self._why_late(view) is not None:
            return []
        first, worst = found
        values = ", ".join(f"{self.signals[name]} = {_at(each, first):g}" for name, each in samples.items())
        detail = f"{self.formula}: robustness {worst:g}, first false {first:.3f} s after the first input: {values}"
        fields = ", ".join(self.signals.values())
        return [Violation("stl", fields, f"stl {self.formula} of {fields}", detail)]

    def unseen(self, view: TrialView) -> str | None:
        """Return why the formula could not be judged, or not to the end; None if it was."""
        for text in self.signals.values():
            selector = field_selector(text)
            given = not _is_output(view, text) and list(selected(view, selector, view.inputs))
            if not given and (absent := why_unseen(view, selector)) is not None:
                return absent
        samples, end = self._samples(view)
        broken = next((name for name, each in samples.items() if each and math.isnan(each[-1][1])), None)
        if broken is not None:
            return f"{self.signals[broken]} is NaN, so nothing is judged from then on (`finite` finds that)"
        if (why := self._why_short(samples, end) or self._why_vacuous(samples, end)) is not None:
            return why
        late = self._why_late(view)
        return late if late is not None and self._first_false(samples, end) is not None else None

    def forge(self, view: TrialView) -> TrialView:
        """Return a copy in which each output signal is constant, and each input signal too if that is not enough."""
        samples, end = self._samples(view)
        own = [name for name, text in self.signals.items() if _is_output(view, text)]
        numbers = [float(each) for each in _NUMBER.findall(self.formula)]
        choices = dict.fromkeys([0.0, 1.0, *(each + step for each in numbers for step in (-1, 1, 0)), -1e6, 1e6])
        tries = (
            dict(zip(names, values, strict=True))
            for names in ((own, self.signals) if len(own) < len(self.signals) else (own,))
            for values in islice(product(choices, repeat=len(names)), _MOST_TRIED)
        )
        for chosen in tries:
            constant = {name: [[samples[name][0][0], value]] for name, value in chosen.items()}
            try:
                if self._first_false(samples | constant, end) is None:
                    continue
                forged = self._with(view, {self.signals[name]: value for name, value in chosen.items()})
                if self.judge(forged):
                    return forged
            except PayloadError:
                continue
        raise PayloadError("no constant values that were tried for its fields violate it")

    def _with(self, view: TrialView, values: Mapping[str, float]) -> TrialView:
        changed: dict[int, Message] = {}
        for text, value in values.items():
            selector = field_selector(text)
            for message, kind in selected(view, selector, None if _is_output(view, text) else view.inputs):
                now, path = changed.get(id(message), message), selector.field or ""
                old: Scalar = read_field(kind, message.payload, path)
                whole = int(value) if isinstance(old, int) and value.is_integer() else value
                new = bool(value) if isinstance(old, bool) else whole
                changed[id(message)] = now.with_payload(kind.rebuild(now.payload, {path: new}))
        inputs, outputs = ([changed.get(id(it), it) for it in each] for each in (view.inputs, view.outputs))
        return replace(view, inputs=inputs, outputs=outputs)

    def _samples(self, view: TrialView) -> tuple[dict[str, _Samples], float]:
        """Return time (seconds after the first input) and value of each change, and until when they may be judged."""
        found: dict[str, _Samples] = {}
        end = (view.end - view.start) / 1e9
        for name, text in self.signals.items():
            selector = field_selector(text)
            is_output = _is_output(view, text)
            messages = selected(view, selector, None if is_output else view.inputs)
            each: _Samples = []
            found[name] = each
            for message, kind in sorted(messages, key=lambda it: it[0].time):
                try:
                    value = read_field(kind, message.payload, selector.field or "")
                except PayloadError:
                    if is_output:
                        raise
                    continue  # such as an input that riot has truncated
                if not isinstance(value, bool | int | float):
                    continue
                time = (message.time - view.start) / 1e9
                if each and each[-1][0] == time:
                    each.pop()
                limited = float(min(max(value, -_MOST), _MOST)) if value == value else math.nan
                if not each or each[-1][1] != limited:
                    each.append([time, limited])
                if limited != limited:
                    end = min(end, math.nextafter(time, -math.inf))
                    break
        if (count := sum(map(len, found.values()))) > _MOST_CHANGES:
            raise PayloadError(f"{count} changes of the signals of a formula, at most {_MOST_CHANGES} are judged")
        return found, end

    def _why_short(self, samples: Mapping[str, _Samples], end: float) -> str | None:
        if not all(samples.values()):
            return "a signal has no value"
        ahead, start = _ahead(_Parsed(self).node), max(each[0][0] for each in samples.values())
        if end - start >= ahead:
            return None
        return f"watched for {max(0.0, end - start):.3f} s with values of all signals, it looks {ahead:g} s ahead"

    def _why_late(self, view: TrialView) -> str | None:
        """Return why times are unreliable; None if they are reliable, or the formula has no time bounds."""
        if not view.late or not _is_bounded(_Parsed(self).node):
            return None
        return f"it did not hold, but the machine was busy: outputs may be {view.late:.3f} s late"

    def _why_vacuous(self, samples: Mapping[str, _Samples], end: float) -> str | None:
        """Return which antecedent never held, so that its implication could not be violated; None if all did."""
        for number in range(len(_Parsed(self).implications)):
            parsed = _Parsed(self)
            antecedent, ahead = parsed.implications[number]
            _, judged = self._judged(samples, end, parsed, antecedent, ahead)
            best = max(value for _, value in judged)
            if best <= 0:
                return f"antecedent never held: the robustness of {antecedent.name} was at most {best:g}, not above 0"
        return None

    def _first_false(self, samples: Mapping[str, _Samples], end: float) -> tuple[float, float] | None:
        """Return the first time at which it does not hold, and the least robustness; None if it holds."""
        parsed = _Parsed(self)
        start, judged = self._judged(samples, end, parsed, parsed.node, parsed.ahead)
        false = [(time, value) for time, value in judged if value < 0]
        return (start + false[0][0], min(value for _, value in false)) if false else None

    def _judged(
        self, samples: Mapping[str, _Samples], end: float, parsed: _Parsed, node: Any, ahead: float | None
    ) -> tuple[float, _Samples]:
        """Return when judging begins, and the robustness of a node at all judged times, counted from then.

        Args:
            ahead: Seconds before the end at which judging stops; None to judge only at the beginning.
        """
        start = max(each[0][0] for each in samples.values())
        moved = {
            name: [[0.0, _at(each, start)], *([time - start, value] for time, value in each if start < time <= end)]
            for name, each in samples.items()
        }
        last = 0.0 if ahead is None else end - start - ahead
        judged = [[time, value] for time, value in parsed.robustness(node, moved) if time <= last]
        if any(math.isnan(value) for _, value in judged):
            raise PayloadError("the formula has no value: it computes inf - inf or the like")
        return start, judged


class _Parsed:
    """A formula parsed by rtamt; to be created for each use, since rtamt keeps the state of an evaluation.

    Attributes:
        node: Node that has to hold; for an outermost `always`, its operand.
        ahead: Seconds before the end at which it has to hold for the last time; None if only at the beginning.
        implications: Antecedents of the implications that all have to hold, each with its own `ahead`.
    """

    def __init__(self, monitor: Stl) -> None:
        try:
            import rtamt
        except ImportError as error:
            if sys.version_info >= (3, 13):
                text = "the package rtamt, which judges formulas, has no release for Python 3.13 and newer"
                raise ConfigError(text, hint="use Python 3.11 or 3.12") from error
            raise MissingExtraError("rtamt", "stl") from error
        self._spec = rtamt.StlDenseTimeOfflineSpecification()
        for name in monitor.signals:
            self._spec.declare_var(name, "float")
        self._spec.spec = monitor.formula
        try:
            self._spec.parse()
        except RecursionError:
            raise ConfigError("formula: too deeply nested", hint="make two monitors of it") from None
        except Exception as error:  # it raises AttributeError for some wrong formulas, besides its own
            text = str(error).removeprefix("RTAMT Exception: ").partition(" expecting {")[0].strip()
            hint = "such as: always ((speed > 0.5) implies (eventually[0:2] (ack >= 1)))"
            raise ConfigError(f"formula: {text} in {monitor.formula!r}", hint=hint) from error
        if len(self._spec.ast.specs) != 1:
            raise ConfigError("formula: there is more than one", hint="join them with 'and', or make two monitors")
        top = self._spec.ast.specs[0]
        is_always = type(top).__name__ == "Always"
        self.node = top.children[0] if is_always else top
        self.ahead = _ahead(self.node) if is_always else None
        self.implications = list(_implications(self.node, self.ahead))

    def robustness(self, node: Any, samples: Mapping[str, _Samples]) -> _Samples:
        """Return the robustness of a node over time; can be called only once."""
        self._spec.ast.specs[:] = [node]
        try:
            found: _Samples = self._spec.evaluate(*([name, each] for name, each in samples.items()))
        except Exception as error:  # such as ZeroDivisionError, OverflowError
            raise PayloadError(f"the formula cannot be evaluated: {error}") from error
        return found


def _ahead(node: Any) -> float:
    """Return how many seconds a node looks ahead; raises ConfigError for wrong or unsupported bounds."""
    inner = max(map(_ahead, node.children), default=0.0)
    kind = type(node).__name__
    if kind in _FUTURE and inner:
        hint = (
            "let an unbounded operator look at bounded ones only as the outermost 'always'; make two monitors of 'and'"
        )
        raise ConfigError(f"formula: bounded operators inside an unbounded {kind.lower()!r}", hint=hint)
    if hasattr(node, "begin"):
        if not node.begin <= node.end <= _MOST_AHEAD:
            hint = f"write it [from:to] in seconds, such as [0:2], at most {_MOST_AHEAD}"
            raise ConfigError(f"formula: {kind.removeprefix('Timed').lower()!r} has wrong bounds", hint=hint)
        return inner + (float(node.end) if kind.removeprefix("Timed") in _FUTURE else 0.0)
    return inner


def _is_bounded(node: Any) -> bool:
    return hasattr(node, "begin") or any(map(_is_bounded, node.children))


def _implications(node: Any, ahead: float | None) -> Iterator[tuple[Any, float | None]]:
    """Yield the antecedents of the implications that all have to hold for a node to hold, each with its `ahead`."""
    kind = type(node).__name__
    if kind == "Implies":
        yield node.children[0], ahead
    elif kind in ("Conjunction", "Always"):
        for child in node.children:
            yield from _implications(child, 0.0 if kind == "Always" else ahead)


def _is_output(view: TrialView, text: str) -> bool:
    return why_no_message(view, field_selector(text).topic) is None


def _at(samples: _Samples, time: float) -> float:
    return samples[bisect_right(samples, time, key=lambda each: each[0]) - 1][1]
