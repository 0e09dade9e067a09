"""The external fields of a system: the inputs that the outside controls, and their behaviour in the nominal log."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median, pstdev

from riot_bus.backchain.encoding import SearchField
from riot_bus.campaign.targets import ELEMENTS, Target, any_names, may_change, samples_by_topic, targets_of
from riot_bus.chain.base.logs import nominal_values
from riot_bus.chain.base.workspace import Workspace
from riot_bus.generalize.forms.standalone import INTEGERS
from riot_bus.system.system_file import Parameter, RunPace, SystemFile
from riot_bus.types.brittle import why_brittle
from riot_bus.types.model import family_of
from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.vocabulary.field_pattern import names_field
from riot_bus.vocabulary.injection import PARAMETERS, Injection, Signal
from riot_bus.vocabulary.message import Message, Scalar

_REACH = 2500.0
_LIMITS = {**INTEGERS, "bool": (0, 1)}
"""Least and largest value of each type of whole numbers."""
DELAY, LOSS = "#delay", "#loss"
"""Names, after the topic, of the fields for the delay of its messages in seconds and the share that is lost. No field
of a type has such a name."""


_NEVER = "a topic without a message in the nominal log"
_NO_TYPE = "messages of a type that is not known"
_FURTHER = f"of an array, only the first {ELEMENTS} elements are driven"
_BYTES = "bytes are not driven"
_NOT_FINITE = "never a finite number in the nominal log"


@dataclass(frozen=True, slots=True)
class ExternalField:
    """An input that the outside controls, as a number: a field, the length of an array, or a parameter of commands.

    It may also be the delay of a topic's messages, in seconds, or the share of them that is lost.

    Attributes:
        path: Path of the field; `len(path)` of an array; the parameter's name; `DELAY` or `LOSS`.
        nominal: Median in the nominal log; for a field with choices, the most frequent one.
        spread: Standard deviation there; a tenth of the size, or 1, for a constant field; a half for choices.
        low: Smallest nominal value; for a constant field, a spread below it; for a boolean, or choices, 0.
        high: Largest nominal value; for a constant field, a spread above it; for a boolean 1; the last choice.
        range: Values that may be tried, from riot.toml or 2,500 spreads around the nominal value, within its type.
        rate: Messages per second of its topic in the nominal log.
        choices: Its possible values, from riot.toml, or the texts of the nominal log; empty for a number.
    """

    name: str
    topic: str
    path: str
    type: str
    nominal: float
    spread: float
    low: float
    high: float
    range: tuple[float, float]
    rate: float
    choices: tuple[Scalar, ...] = ()

    @property
    def integer(self) -> bool:
        """Whether its values are whole numbers."""
        return bool(self.choices) or "int" in self.type or self.type == "bool"

    @property
    def parameter(self) -> bool:
        """Whether it is a parameter of commands, which has one value in a run."""
        return self.topic == PARAMETERS

    @property
    def constant(self) -> bool:
        """Whether it has one value in a run, since it is not a field of messages."""
        return self.parameter or self.timing

    @property
    def timing(self) -> bool:
        """Whether it is the delay of messages, or the share that is lost."""
        return self.path in (DELAY, LOSS)

    @property
    def alone(self) -> bool:
        """Whether it has only one known choice."""
        return len(self.choices) == 1

    def told(self, value: float) -> Scalar:
        """Return what a number stands for, in the field's own type."""
        if self.choices:
            return self.choices[min(max(round(value), 0), len(self.choices) - 1)]
        if not self.integer or not math.isfinite(value):
            return value
        least, most = _LIMITS[self.type]
        return min(max(round(value), least), most)  # as a float, the largest 64-bit value is rounded up

    def injection(
        self,
        value: float,
        *,
        speed: float = 1.0,
        start: float = 0.0,
        end: float | None = None,
        message: int | None = None,
    ) -> Injection:
        """Return the injection that sets it to a number.

        Args:
            speed: Speed of the run, as a multiple of the system's own time.
            message: Number of the only message of its topic that is changed; None for all in that time.
        """
        if self.path == DELAY:
            return Injection(self.topic, fault="delay", delay=value / speed)
        if self.path == LOSS:
            return Injection(self.topic, fault="drop", probability=value)
        return Injection(
            self.topic, self.path, self.told(value), start=start, end=end, first=message or 0, last=message
        )

    def search_field(self) -> SearchField:
        """Return it as a field of a search."""
        low, high = self.range
        return SearchField(
            self.name, self.nominal, self.spread, low, high, integer=self.integer, choice=bool(self.choices)
        )

    def signal(self, seed: int, *, hold: int) -> Signal:
        """Return a random signal over its nominal range."""
        half = (self.high - self.low) / 2
        # so that all choices are equally likely
        reach = half + 0.499 if self.choices else half
        return Signal((self.high + self.low) / 2, reach, hold, seed, self.integer, self.choices)


def message_rate(times: Iterable[int]) -> float:
    """Return messages per second from their times in nanoseconds."""
    stamps = list(times)
    return (len(stamps) - 1) / max(1e-9, (stamps[-1] - stamps[0]) / 1e9) if len(stamps) > 1 else 0.0


def external_messages(workspace: Workspace) -> list[Message]:
    """Return the messages of the nominal log that come from outside.

    Raises:
        ConfigError: riot.toml names no external topic.
    """
    file, registry = workspace.context.file, workspace.context.registry
    if not file.external.topics:
        raise ConfigError(
            "no external topics", where=f"{file.path}: [external]", hint="list what the outside controls in `topics`"
        )
    told = file.system.clock.topic if file.system.clock else None  # riot publishes it, in the time of its runs
    log = [one for one in workspace.nominal_messages() if told is None or registry.topic(one.key) != told]
    return [one for one in log if any(registry.matches(topic, one.key) for topic in file.external.topics)]


def driving_log(workspace: Workspace, pace: RunPace) -> tuple[Message, ...]:
    """Return the messages to play to the system in a nominal run; none if riot.toml names external components.

    Raises:
        ConfigError: There are no external components, and nothing external in the nominal log, or they share the
            system's segment.
    """
    workspace.context.file.check_outside_apart()
    if any(component.external for component in workspace.context.file.components.values()):
        return ()
    messages = system_log(workspace, pace.duration)
    begin, slower = messages[0].time, workspace.context.file.system.nominal_run.speed / pace.speed
    return tuple(one.with_(time=begin + round((one.time - begin) * slower)) for one in messages)


def system_log(workspace: Workspace, duration: float | None = None) -> tuple[Message, ...]:
    """Return the external messages at the start of the nominal log, which has the speed of `nominal_run`.

    Args:
        duration: Seconds of the system's own time; by default those of a `trial_run`.

    Raises:
        ConfigError: Nothing comes from outside, or external components share the system's segment.
    """
    file = workspace.context.file
    file.check_outside_apart()
    messages = external_messages(workspace)
    if not messages:
        raise ConfigError(
            f"the nominal log holds nothing on {', '.join(file.external.topics)}", where=f"{file.path}: [external]"
        )
    seconds = (file.system.trial_run.duration if duration is None else duration) / file.system.nominal_run.speed
    end = messages[0].time + round(seconds * 1e9)
    return tuple(message for message in messages if message.time <= end)


def external_fields(workspace: Workspace) -> list[ExternalField]:
    """List all external fields but bytes, with their behaviour in the nominal log, and what riot.toml adds to them.

    Raises:
        ConfigError: riot.toml names no external topic, or the nominal log holds none of them.
    """
    file, registry = workspace.context.file, workspace.context.registry
    messages = external_messages(workspace)
    targets = targets_of(messages, registry, leave=file.external.exclude)
    targets = {topic: [target for target in fields if target.type != "bytes"] for topic, fields in targets.items()}
    for topic, lengths in _lengths(messages, workspace).items():
        targets.setdefault(topic, []).extend(lengths)
    if not any(targets.values()):
        present = {registry.topic(one.key) for one in workspace.nominal_messages()}
        raise ConfigError(
            f"the nominal log holds no field of {', '.join(file.external.topics)}",
            where=str(workspace.nominal_log()),
            hint=did_you_mean(file.external.topics[0], present),
        )
    values = nominal_values(
        messages, {topic: [one.path for one in some] for topic, some in targets.items()}, registry=registry
    )
    times: dict[str, list[int]] = {}
    for message in messages:
        times.setdefault(registry.topic(message.key), []).append(message.time)
    fields = []
    for topic, some in targets.items():
        for target in some:
            seen, rate = values[f"{topic}:{target.path}"], message_rate(times[topic])
            if choices := _choices(f"{topic}:{target.path}", seen, file):
                fields.append(_chosen(target, choices, seen, rate))
            elif numbers := [float(one) for one in seen if isinstance(one, int | float) and math.isfinite(one)]:
                fields.append(_described(topic, target.path, target.type, numbers, rate, file))
    fields += [_parameter(name, each) for name, each in file.external.parameters.items()]
    return fields + [one for topic in file.external.timing for one in _timing(topic, times, file)]


def left_out(workspace: Workspace, fields: Sequence[ExternalField]) -> dict[str, str]:
    """Return the external inputs that are not driven, and why, without those that riot.toml excludes.

    Raises:
        ConfigError: riot.toml names no external topic.
    """
    file, registry = workspace.context.file, workspace.context.registry
    messages, known = external_messages(workspace), {field.name for field in fields}
    keys = {message.key for message in messages}
    topics = file.external.topics
    found = {topic: _NEVER for topic in topics if not any(registry.matches(topic, key) for key in keys)}
    for topic, (_, samples) in samples_by_topic(messages, registry).items():
        if not samples:
            found[topic] = _NO_TYPE
        for sample in samples:
            for leaf in sample.leaves(ELEMENTS + 1):
                name = f"{topic}:{leaf.path}"
                if leaf.path.startswith("len(") or any_names(file.external.exclude, topic, leaf.path):
                    continue
                if f"[{ELEMENTS}]" in leaf.path:
                    found[f"{topic}:{family_of(leaf.path)}"] = _FURTHER
                elif why := why_brittle(leaf.path, sample.kind):
                    found[name] = f"a {why}, which is left alone"
                elif name not in known:
                    found[name] = _BYTES if leaf.type == "bytes" else _NOT_FINITE
    return found


def _lengths(messages: Sequence[Message], workspace: Workspace) -> dict[str, list[Target]]:
    """Return the lengths of arrays that may change, by topic."""
    leave, found = workspace.context.file.external.exclude, dict[str, list[Target]]()
    for topic, (count, samples) in samples_by_topic(messages, workspace.context.registry).items():
        paths: dict[str, str] = {}
        for sample in samples:
            for leaf in sample.leaves():
                if leaf.path.startswith("len(") and may_change(topic, leaf.path, leave, (), kind=sample.kind):
                    paths.setdefault(leaf.path, leaf.type)
        if paths:
            found[topic] = [Target(topic, path, type_name, count) for path, type_name in paths.items()]
    return found


def _timing(topic: str, times: Mapping[str, Sequence[int]], file: SystemFile) -> Iterator[ExternalField]:
    """Yield the fields for the delay of a topic's messages and for the share that is lost.

    Raises:
        ConfigError: The nominal log has no such message, or a range of riot.toml loses more than all of them.
    """
    if topic not in times:
        raise ConfigError(
            f"no message of {topic!r} in the nominal log",
            where=f"{file.path}: external.timing",
            hint=did_you_mean(topic, times) or "list topics of `external.topics`",
        )
    system, rate = file.system, message_rate(times[topic])
    late = 10 / rate * system.nominal_run.speed if rate else system.trial_run.duration / 2
    # not all messages are lost, since a failing run is replayed from those that came
    for path, most in ((DELAY, late), (LOSS, 0.95)):
        name = f"{topic}:{path}"
        if any_names(file.external.exclude, topic, path):
            continue
        low, high = _range(name, (0.0, most), file)
        if path == LOSS and high > 1:
            raise ConfigError(f"a share of {high:g} cannot be lost", where=f"{file.path}: external.ranges")
        yield ExternalField(name, topic, path, "float64", 0.0, (high - low) / 10, low, high, (low, high), rate)


def _parameter(name: str, told: Parameter) -> ExternalField:
    if told.range is None:
        return _chosen(Target(PARAMETERS, name, "", 0), told.values, [told.nominal], 0.0)
    nominal, (low, high) = float(told.nominal), told.range
    kind, spread = "int64" if isinstance(told.nominal, int) else "float64", (high - low) / 10
    return ExternalField(parameter_name(name), PARAMETERS, name, kind, nominal, spread, low, high, told.range, 0.0)


def parameter_name(name: str) -> str:
    """Return the name of a parameter of commands in findings."""
    return f"{PARAMETERS.removeprefix('#')}:{name}"


def _choices(name: str, seen: Sequence[Scalar], file: SystemFile) -> tuple[Scalar, ...]:
    """Return the values of a field from riot.toml, or its texts in the log; nothing if it is a number."""
    stated = [values for pattern, values in file.external.values.items() if names_field(pattern, name)]
    if stated:
        return stated[-1]
    return tuple(text for text, _ in Counter(one for one in seen if isinstance(one, str)).most_common(16))


def _chosen(target: Target, choices: tuple[Scalar, ...], seen: Sequence[Scalar], rate: float) -> ExternalField:
    often = [one for one, _ in Counter(seen).most_common() if one in choices]
    nominal, last = float(choices.index(often[0]) if often else 0), float(len(choices) - 1)
    name = parameter_name(target.path) if target.topic == PARAMETERS else f"{target.topic}:{target.path}"
    return ExternalField(
        name, target.topic, target.path, target.type, nominal, 0.5, 0.0, last, (0.0, last), rate, choices
    )


def _described(
    topic: str, path: str, type_name: str, numbers: list[float], rate: float, file: SystemFile
) -> ExternalField:
    name = f"{topic}:{path}"
    nominal = median(numbers)
    spread = pstdev(numbers)
    if spread <= 1e-9 * max(1.0, abs(nominal)):
        spread = abs(nominal) / 10 or 1.0
        spread = max(spread, 1.0) if "int" in type_name else spread
    low, high = (min(numbers), max(numbers)) if len(set(numbers)) > 1 else (nominal - spread, nominal + spread)
    if type_name == "bool":
        low, high, spread = 0.0, 1.0, 0.5
    least, most = _LIMITS.get(type_name, (-math.inf, math.inf))
    usual = (nominal - _REACH * spread, nominal + _REACH * spread)
    if path.startswith("len("):
        # longer than anything that was foreseen, but an image does not fill memory
        usual = (0.0, max(16, min(4 * max(numbers), max(numbers) + (1 << 16))))
    low, high, first, last = (float(min(max(one, least), most)) for one in (low, high, *_range(name, usual, file)))
    return ExternalField(name, topic, path, type_name, nominal, spread, low, high, (first, last), rate)


def _range(name: str, usual: tuple[float, float], file: SystemFile) -> tuple[float, float]:
    """Return the range that riot.toml states for a field, or the usual one.

    Delays, losses and lengths of arrays only match patterns that name them with `#` or `len(`.

    Raises:
        ConfigError: The range of such a pattern is empty or begins below 0.
    """
    said = [sign for sign in ("#", "len(") if sign in name]
    for pattern, limits in reversed(file.external.ranges.items()):
        if names_field(pattern, name) and all(sign in pattern for sign in said):
            if said and not 0 <= limits[0] < limits[1]:
                where = f"{file.path}: external.ranges"
                raise ConfigError(f"{pattern!r} is not a range from 0 up: {list(limits)}", where=where)
            return limits
    return usual
