"""Whether a message contradicts what a dictionary states of sound messages."""

from __future__ import annotations

from riot_bus.inject.formula import evaluate
from riot_bus.inject.mutations import Mutation
from riot_bus.types.model import MessageType
from riot_bus.vocabulary.injection import Formula


def breaks(mutation: Mutation, kind: MessageType, payload: bytes, base: str = "") -> bool:
    """Return whether a message contradicts the formula `consistent`; False if there is no formula."""
    formula = Formula(mutation.consistent, base)
    return bool(mutation.consistent) and not evaluate(formula, lambda path: kind.read(payload, path))
