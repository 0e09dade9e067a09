from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_logtools.editing.options import EditOptions


def options(**more: Any) -> EditOptions:
    return EditOptions(inputs=[Path("a.mcap")], output=Path("b.mcap"), **more)


def test_the_steps_of_an_edit() -> None:
    design = options(keep=["/a"], drop=["/b"], changes=["/a:x = 1"], shifts=["0.5", "/b=-1"], remap=["/a:=/c"]).design()
    assert [each.topic for each in (*design.keep, *design.drop)] == ["/a", "/b"]
    assert [(each.topic, each.delta) for each in design.shifts] == [(None, 5 * 10**8), ("/b", -(10**9))]
    assert (design.changes[0].field, design.remaps) == ("x", {"/a": "/c"})


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"compression": "zip"}, "unknown compression"),
        ({"duration": 1.0, "end": "2"}, "both say where to end"),
        ({"duration": 0.0}, "not above 0"),
        ({"split_seconds": 1e10}, "above 9e"),
        ({"chunk_bytes": 0}, "1 to"),
        ({"split_bytes": 0}, "at least 1 byte"),
        ({"shifts": ["soon"]}, "how far"),
        ({"shifts": ["=1"]}, "how far"),
    ],
)
def test_wrong_options(more: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        options(**more).design()


def test_the_output_says_what_was_asked_for() -> None:
    found = options(changes=["/a:x = 1"], force=True).to_json()
    assert (found["set"], "force" in found, "without_originals" in found) == (["/a:x = 1"], False, False)
    assert EditOptions(inputs=[Path("a")], output=Path("bag")).to_json()["without_originals"]
