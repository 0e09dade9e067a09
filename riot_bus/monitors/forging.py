"""Copies of a nominal trial that are forged to violate a monitor, to show that it is able to fire at all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import islice, product

from riot_bus.monitors.model import Forges, Monitor, TrialView, names_of, why_no_message, why_nothing_to_judge
from riot_bus.monitors.selection import selected
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.message import Message, Scalar
from riot_bus.vocabulary.predicate import parse_predicate
from riot_bus.vocabulary.selector import Selector

_MOST_TRIED = 4096  # each rebuilds a payload; choices for fields multiply, and `modulo` may be large


def why_cannot_fire(monitor: Monitor, view: TrialView) -> str | None:
    """Return why a monitor is not shown to be able to fire; None if it fires on a forged copy of a trial."""
    try:
        found = monitor.judge(view)
        if found:
            return f"the trial itself violates it: {found[0].detail or found[0].signature}"
        reason = why_nothing_to_judge(monitor, view)
        if reason is not None:
            return reason
        if not isinstance(monitor, Forges):
            return "cannot be shown: it has no method `forge`"
        return None if monitor.judge(monitor.forge(view)) else "it is silent on a trial that is to violate it"
    except Exception as error:  # a monitor may be third-party code and raise anything
        return f"{type(error).__name__}: {error}"


def mute_monitors(view: TrialView, monitors: Sequence[Monitor]) -> tuple[str, ...]:
    """Return a line for each monitor that stays silent on a copy of a trial that is forged to violate it.

    Monitors without `forge`, and those that have nothing to judge in this trial, are skipped.
    """
    view = replace(view, held_up=0.0)  # no tolerance for a busy machine in forged trials
    return tuple(
        f"{name}: {reason}"
        for name, monitor in zip(names_of(monitors), monitors, strict=True)
        if isinstance(monitor, Forges) and why_nothing_to_judge(monitor, view) is None
        if (reason := why_cannot_fire(monitor, view)) is not None
    )


def with_value(
    view: TrialView, selector: Selector, values: Iterable[Scalar], violates: Callable[[Scalar], bool]
) -> TrialView:
    """Return a copy whose last selected output has another value in the field.

    Args:
        view: View of a trial.
        selector: Selects a field.
        values: Values to try, in this order, until one that is read back violates.
        violates: Function that returns whether a value violates.

    Raises:
        PayloadError: There is no such output, or the field can hold none of these values.
    """
    chosen = list(selected(view, selector))
    if not chosen:
        raise PayloadError(why_no_message(view, selector.topic) or f"no message meets {selector.where!r}")
    message, kind = chosen[-1]
    path, tried = selector.field or "", 0
    for value in islice(values, _MOST_TRIED):
        tried += 1
        try:
            payload = kind.rebuild(message.payload, {path: value})
            if violates(kind.read(payload, path)):
                changed = message.with_payload(payload)
                return replace(view, outputs=[changed if each is message else each for each in view.outputs])
        except PayloadError:
            continue
    raise PayloadError(f"{selector.topic}:{path} can hold no value that violates it ({tried} tried)")


def without(view: TrialView, selector: Selector, *, seconds: float = 0.0) -> TrialView:
    """Return a copy without the selected outputs that was watched for at least `seconds`."""
    dropped = {id(message) for message, _ in selected(view, selector)}
    outputs = [message for message in view.outputs if id(message) not in dropped]
    return replace(view, outputs=outputs, end=max(view.end, view.start + round(seconds * 1e9)))


def with_message(view: TrialView, selector: Selector) -> TrialView:
    """Return a copy with one more output, which meets the selector: an output of the topic, changed as needed.

    Raises:
        PayloadError: There is no output of the topic, or it cannot be made to meet the condition.
    """
    models = list(selected(view, Selector(selector.topic)))
    if selector.where is None:
        expression = view.registry.key_expression(selector.topic)
        key = models[0][0].key if models else expression.replace("$*", "x").replace("**", "x").replace("*", "x")
        message = models[0][0] if models else Message(view.end, key, b"{}")
        return replace(view, outputs=[*view.outputs, message.with_(time=view.end)])
    predicate = parse_predicate(selector.where)
    choices = predicate.candidates()
    for message, kind in models[:1]:
        for values in islice(product(*choices.values()), _MOST_TRIED):
            changes = dict(zip(choices, values, strict=True))
            try:
                if not predicate(changes.__getitem__):
                    continue
                payload = kind.rebuild(message.payload, changes)
                if predicate(lambda path, kind=kind, payload=payload: kind.read(payload, path)):  # type: ignore[misc]
                    forged = message.with_payload(payload).with_(time=view.end)
                    return replace(view, outputs=[*view.outputs, forged])
            except PayloadError:
                continue
        raise PayloadError(f"no message of {selector.topic!r} can be made to meet {selector.where!r}")
    raise PayloadError(why_no_message(view, selector.topic) or "")
