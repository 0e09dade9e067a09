"""What a system's context says of its monitors, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.trial.context import invariants_of, open_system
from riot_bus.vocabulary.errors import ConfigError

SYSTEM = """
[components.arm]
command = ["arm"]
outputs = ["arm/state"]
[components.eye]
command = ["eye"]
outputs = ["eye/state"]
[unit.arm]
command = ["arm", "--checked"]
[[monitors]]
kind = "range"
field = "arm/state:x"
max = 1
[[monitors]]
kind = "range"
field = "eye/state:x"
max = 1
"""


def written(folder: Path, text: str = SYSTEM) -> Path:
    path = folder / "riot.toml"
    path.write_text(text)
    return path


def test_a_component_alone_is_judged_by_the_monitors_of_its_own_topics(tmp_path: Path) -> None:
    context = open_system(written(tmp_path))
    assert context.watched == ["arm/state", "eye/state"]
    own = {topic for monitor in context.monitors_of("arm") for topic in getattr(monitor, "topics", ())}
    assert own == {"arm/state"}
    assert context.others_publish("eye/state", "arm")
    assert not context.others_publish("arm/state", "arm")


def test_a_unit_with_a_command_of_its_own_has_another_context(tmp_path: Path) -> None:
    context = open_system(written(tmp_path))
    alone = context.alone("arm")
    assert alone.file.components["arm"].command == ("arm", "--checked")
    assert alone.hangs is context.hangs
    assert context.fingerprint() == open_system(tmp_path / "riot.toml").fingerprint()


def test_definitions_that_are_missing_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file"):
        open_system(written(tmp_path, f'[system]\nmessages = ["none.msg"]\n{SYSTEM}'))


def test_invariants_are_read_without_a_trial(tmp_path: Path) -> None:
    assert len(invariants_of(written(tmp_path))) == 2
    with pytest.raises(ConfigError, match="there is no such system file"):
        invariants_of(tmp_path / "other.toml")
