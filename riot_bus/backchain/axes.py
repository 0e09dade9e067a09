"""Which two external fields a crash region is drawn in."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.vocabulary.trial import Ask

__all__ = ["choose_axes"]


def choose_axes(
    preferred: Sequence[str],
    found: Mapping[str, float],
    nominal: Mapping[str, float],
    fails: Ask[Mapping[str, float]],
) -> tuple[tuple[str, str], dict[str, float]]:
    """Choose two fields, and the values that others need to have.

    The first two are taken if they make the failure happen alone; else those that it needs come first: with them at
    their nominal values it does not happen.

    Args:
        preferred: At least two fields, the most telling first.
        found: A failing point.
        nominal: The nominal value of each field.
        fails: Whether the failure happens at each point; fields that are not named there are left alone.

    Returns:
        The fields, and values of others without which it does not happen.
    """
    first = (preferred[0], preferred[1])

    def alone(axes: tuple[str, str]) -> bool:
        return fails([{name: found.get(name, nominal[name]) for name in axes}])[0]

    def others(axes: tuple[str, str]) -> dict[str, float]:
        return {name: value for name, value in found.items() if name not in axes}

    if alone(first):
        return first, {}
    moved = [name for name in preferred if name in found and found[name] != nominal[name]]
    answers = fails([{**found, name: nominal[name]} for name in moved]) if moved else []
    needed = [name for name, failed in zip(moved, answers, strict=True) if not failed]
    one, two = [*needed, *(name for name in preferred if name not in needed)][:2]
    axes = (one, two)
    return axes, {} if axes != first and alone(axes) else others(axes)
