"""All inputs that fuzzing has found worth keeping, through their targets once more."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fuzz.targets import TARGETS, seeds

CORPORA = Path(__file__).with_name("corpus")
MOST_BYTES = 300_000
"""Of one corpus: small enough to be kept."""


@pytest.mark.parametrize("name", TARGETS)
def test_what_was_found_once_still_does_no_harm(name: str) -> None:
    inputs = [path.read_bytes() for path in sorted((CORPORA / name).glob("*"))]
    assert sum(map(len, inputs)) < MOST_BYTES
    assert len(inputs) >= len(seeds(name))
    for data in [*inputs, *seeds(name), b""]:
        TARGETS[name](data)
