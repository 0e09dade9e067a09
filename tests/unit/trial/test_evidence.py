from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from riot_bus.log.reader import LogReader, read_log
from riot_bus.monitors.model import ComponentView, ResourceSample, Signs, TrialView
from riot_bus.system.system_file import SystemFile
from riot_bus.trial import evidence
from riot_bus.trial.context import Context
from riot_bus.trial.evidence import native_backtrace, write_evidence
from riot_bus.trial.processes import FIXED, fixes_addresses
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Violation


def context(surroundings: str = "fixed") -> Context:
    table = {
        "system": {"surroundings": surroundings},
        "components": {"part": {"command": ["part"], "env": {"TZ": "CET"}}},
    }
    return Context(SystemFile.model_validate(table), TypeRegistry(), ())


def view(*outputs: Message) -> TrialView:
    component = ComponentView(
        "part",
        3,
        "its last words\n",
        Path("/srv"),
        resources=[ResourceSample(1, 2, 3, 4, 5)],
        stack=[("/srv/part", "poke"), ("/srv/part", "main")],
        signs=Signs(stacks="Thread 1"),
    )
    return TrialView([component], True, 2.0, TypeRegistry(), outputs)


def test_what_a_trial_leaves_is_in_files(tmp_path: Path) -> None:
    violation = Violation("crash", "part", "crash in part: f", "no")
    sizes = write_evidence(tmp_path / "e", view(Message(7, "out", b"{}")), [violation], context=context())
    assert sizes.keys() == {
        "outputs.mcap",
        "part.native.txt",
        "part.resources.csv",
        "part.stacks.txt",
        "part.stderr.txt",
        "trial.json",
    }
    assert (tmp_path / "e/part.native.txt").read_text() == "/srv/part: poke\n/srv/part: main\n"
    assert (tmp_path / "e/part.stderr.txt").read_text() == "its last words\n"
    assert (tmp_path / "e/part.resources.csv").read_text().splitlines()[1] == "1,2,3,4,5"
    assert [message.key for message in read_log(tmp_path / "e/outputs.mcap")] == ["out"]
    told = json.loads((tmp_path / "e/trial.json").read_text())
    assert told["violations"][0]["signature"] == violation.signature
    assert told["status"] == {"part": 3}
    assert told["surroundings"] == {"part": {**FIXED, "TZ": "CET"}}
    assert told["addresses"] == (
        "the same each time" if fixes_addresses() else "random: the kernel lets no process fix them"
    )
    assert told["commands"] == {"part": ["part"]}
    write_evidence(tmp_path / "f", view(), [], context=context("as they are"))
    assert json.loads((tmp_path / "f/trial.json").read_text())["surroundings"] == "as they are"


def test_the_last_outputs_are_kept_within_a_bound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evidence, "_MOST_OUTPUT", 25)
    write_evidence(tmp_path, view(*(Message(n, f"out/{n}", bytes(10)) for n in range(5))), [], context=context())
    with LogReader(tmp_path / "outputs.mcap") as reader:
        assert [message.key for message in reader.messages()] == ["out/3", "out/4"]
        assert reader.metadata["left out"] == "3"


def test_a_backtrace_is_what_comes_behind_its_mark() -> None:
    assert native_backtrace("output\nriot: backtrace\n#0 f ()\n") == "#0 f ()"
    assert native_backtrace("output") == ""


def test_what_was_written_early_is_kept(tmp_path: Path) -> None:
    (part,) = view().components
    errors = "Traceback\n" + "." * (1 << 20)
    write_evidence(tmp_path, replace(view(), components=[replace(part, errors=errors)]), [], context=context())
    assert (tmp_path / "part.stderr.txt").read_text() == errors
