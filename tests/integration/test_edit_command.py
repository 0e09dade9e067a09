"""`riot edit`, as people use it."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
from pathlib import Path

import pytest

from riot_bus.log.reader import LogReader, read_log
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.vocabulary.message import Message
from tests.integration.router_process import ENVIRONMENT, RIOT, riot
from tests.unit.riot_bus_logtools.editing.edit_tools import json_log, raw

pytestmark = pytest.mark.integration


def names(folder: Path) -> list[str]:
    return sorted(each.name for each in folder.iterdir())


def large(path: Path) -> Path:
    """A log that takes a while."""
    with LogWriter(path, LogSettings(compression="none")) as writer:
        for n in range(100_000):
            writer.write(Message(n, "a", b'{"v": %d, "text": "%s"}' % (n, b"x" * 300), encoding="application/json"))
    return path


def test_what_it_says(tmp_path: Path) -> None:
    log = json_log(tmp_path / "in.mcap", 100)
    out = str(tmp_path / "out.mcap")
    code, text, err = riot("edit", str(log), out, "--set", "a:v = 7 where v > 49", "--drop", "b every 2", "-m", "b:=c")
    assert (code, err) == (0, "")
    table = [line.split() for line in text.splitlines()]
    assert table[:3] == [
        ["topic", "kept", "changed", "dropped", "written", "as"],
        ["a", "50", "25", "0"],
        ["b", "25", "0", "25", "c"],
    ]
    assert table[3][:3] == [f"{out}:", "75", "messages,"]
    assert len(raw(Path(out))) == 75


def test_json_and_dry_run(tmp_path: Path) -> None:
    log = json_log(tmp_path / "in.mcap", 100)
    arguments = ("edit", str(log), str(tmp_path / "out.mcap"), "--start", "5", "--shift", "a=0.5", "--format", "json")
    code, text, err = riot(*arguments, "--dry-run")
    assert (code, err) == (0, "")
    planned = json.loads(text)
    assert names(tmp_path) == ["in.mcap"]
    code, text, err = riot(*arguments)
    assert (code, err) == (0, "")
    done = json.loads(text)
    assert planned["files"] == []
    assert done["files"] == [{"path": arguments[2], "size": os.path.getsize(arguments[2]), "messages": 50}]
    assert done["topics"] == planned["topics"]
    assert done["total"] == {"read": 100, "kept": 50, "changed": 0, "dropped": 50, "added": 0, "originals": 0}


def test_an_output_is_replaced_only_if_wanted_and_an_input_never(tmp_path: Path) -> None:
    log = json_log(tmp_path / "in.mcap", 10)
    before = log.read_bytes()
    (tmp_path / "link.mcap").symlink_to(log)
    os.link(log, tmp_path / "hard.mcap")
    for name in ("in.mcap", "link.mcap", "hard.mcap"):
        code, _, err = riot("edit", str(log), str(tmp_path / name), "--force")
        assert (code, "input and output are the same" in err) == (2, True)
    out = tmp_path / "out.mcap"
    out.write_bytes(b"mine")
    code, _, err = riot("edit", str(log), str(out))
    assert (code, "exists" in err, "--force" in err) == (2, True, True)
    assert out.read_bytes() == b"mine"
    assert riot("edit", str(log), str(out), "--force")[0] == 0
    assert raw(out) == raw(log)
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "thesis.txt").write_text("x")
    code, _, err = riot("edit", str(log), str(folder), "--force")
    assert (code, "holds other things" in err) == (2, True)
    assert names(folder) == ["thesis.txt"]
    assert log.read_bytes() == before
    assert names(tmp_path) == ["folder", "hard.mcap", "in.mcap", "link.mcap", "out.mcap"]


def test_a_folder_is_replaced_as_a_whole(tmp_path: Path) -> None:
    log = json_log(tmp_path / "in.mcap", 100)
    bag = tmp_path / "bag"
    assert riot("edit", str(log), str(bag), "--split-duration", "2s")[0] == 0
    assert names(bag) == [*(f"bag_{n}.mcap" for n in range(5)), "metadata.yaml"]
    assert riot("edit", str(log), str(bag))[0] == 2
    assert riot("edit", str(log), str(bag), "--force")[0] == 0
    assert names(bag) == ["bag_0.mcap", "metadata.yaml"]
    code, _, err = riot("edit", str(bag), str(bag), "--force")
    assert (code, "input and output are the same" in err) == (2, True)
    assert len(raw(bag / "bag_0.mcap")) == 100


def test_a_damaged_log_is_recovered_with_exit_code_3(tmp_path: Path) -> None:
    log = json_log(tmp_path / "in.mcap", 1000, chunk_bytes=2000)
    whole = log.read_bytes()
    log.write_bytes(whole[: len(whole) // 2])
    expected = read_log(log)
    assert 100 < len(expected) < 1000
    code, text, err = riot("edit", str(log), str(tmp_path / "out.mcap"), "--format=json")
    assert code == 3
    assert "the file was not closed" in err
    assert json.loads(text)["losses"] == {str(log): str(_loss(log))}
    assert read_log(tmp_path / "out.mcap") == expected
    with LogReader(tmp_path / "out.mcap") as reader:
        list(reader.messages())
        assert not reader.loss


def test_an_integer_of_many_digits_in_a_plan_is_a_mistake(tmp_path: Path) -> None:
    log, plan = json_log(tmp_path / "in.mcap", 10), tmp_path / "plan.toml"
    for number in ("1" * 5000, "0x" + "f" * 5000):
        plan.write_text(f'[[inject]]\ntopic = "a"\nfield = "v"\nvalue = {number}\n')
        code, text, err = riot("edit", str(log), str(tmp_path / "out.mcap"), "--inject", str(plan))
        assert (code, text, "plan.toml" in err, "Traceback" in err) == (2, "", True, False), err


def _loss(log: Path) -> object:
    with LogReader(log) as reader:
        list(reader.messages())
        return reader.loss


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--set", "a:v"], "does not say what to set"),
        (["--set", "a:w = 1"], "no field 'w'"),
        (["--drop", "x"], "did you mean"),
        (["--keep", "a where v >"], "expected a number"),
        (["--compression", "zst"], "did you mean 'zstd'"),
        (["--interceptor", "dorp"], "did you mean 'drop'"),
        (["--inject", "none.toml"], "cannot read the injection plan"),
        (["--split-size", "1X"], "not a size"),
        (["--split-duration", "soon"], "not a time"),
        (["--chunk-size", "0"], "a chunk has 1 to"),
        (["--start", "yesterday"], "no time"),
        (["--type", "a"], "not a topic and its type"),
        (["--remap", "a:b"], "OLD:=NEW"),
    ],
)
def test_mistakes(tmp_path: Path, arguments: list[str], problem: str) -> None:
    log = json_log(tmp_path / "in.mcap", 10, ("a", "xx"))
    code, text, err = riot("edit", str(log), str(tmp_path / "out.mcap"), *arguments)
    assert (code, text) == (2, "")
    assert problem in err
    assert "Traceback" not in err
    assert names(tmp_path) == ["in.mcap"]


@pytest.mark.parametrize("name", ["none.mcap", "empty.mcap", "text.mcap", "."])
def test_what_is_no_log(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "text.mcap").write_bytes(b"hello world, this is no log at all")
    (tmp_path / "out").mkdir()
    target = tmp_path / name if name != "." else tmp_path / "out"
    code, text, err = riot("edit", str(target), str(tmp_path / "out" / "x.mcap"))
    assert (code, text) == (2, "")
    assert "Traceback" not in err
    assert names(tmp_path / "out") == []


def test_a_plan_and_interceptors(tmp_path: Path) -> None:
    log = json_log(tmp_path / "in.mcap", 100)
    plan = tmp_path / "plan.toml"
    plan.write_text('[[inject]]\ntopic = "a"\nfield = "v"\nvalue = 5\nstart = 5.0\n')
    code, _, err = riot(
        "edit", str(log), str(tmp_path / "out.mcap"), "--inject", str(plan), "--interceptor", "drop every=5 select=b"
    )
    assert (code, err) == (0, "")
    found = read_log(tmp_path / "out.mcap")
    expected = [
        each.with_payload(b'{"v": 5}') if each.key == "a" and each.sequence >= 50 else each
        for each in read_log(log)
        if each.key == "a" or each.sequence // 2 % 5 != 4
    ]
    assert list(found) == expected
    with LogReader(tmp_path / "out.mcap") as reader:
        assert len(list(reader.provenance())) == 25
        (record,) = reader.notes("riot_bus.edit")
    steps = json.loads(record["steps"])
    assert steps["interceptors"] == ["drop every=5 select=b"]
    assert steps["plan"] == plan.read_text()
    code, _, err = riot("edit", str(log), str(tmp_path / "x.mcap"), "--interceptor", "set field=w value=1")
    assert code == 0
    assert "set raised 100 times" in err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_nothing_is_left_behind_when_it_is_interrupted(tmp_path: Path, number: int) -> None:
    log = large(tmp_path / "in.mcap")
    block = tmp_path / "slow.py"
    block.write_text(
        "import sys, time\n"
        "class Slow:\n"
        "    def message(self, event):\n"
        "        if event.index == 5000:\n"
        "            print('here', file=sys.stderr, flush=True)\n"
        "            time.sleep(60)\n"
    )
    out = tmp_path / "out"
    out.mkdir()
    process = subprocess.Popen(
        [*RIOT, "edit", str(log), str(out / "out.mcap"), "--interceptor", str(block)],
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
    )
    assert process.stderr is not None
    try:
        assert process.stderr.readline() == "here\n"
        assert len(names(out)) == 1
        process.send_signal(number)
        process.communicate(timeout=60)
    finally:
        process.kill()
        process.wait(60)
    assert process.returncode == 130
    assert names(out) == []


def test_a_full_disk_is_told_and_nothing_is_left(tmp_path: Path) -> None:
    log = large(tmp_path / "in.mcap")
    out = tmp_path / "out"
    out.mkdir()
    limited = ["bash", "-c", 'ulimit -f 4000; trap "" XFSZ; exec "$@"', "bash", *RIOT]
    done = subprocess.run(
        [*limited, "edit", str(log), str(out / "out.mcap"), "--drop", "a index 3"],
        capture_output=True,
        text=True,
        env=ENVIRONMENT,
        timeout=120,
        check=False,
    )
    assert done.returncode == 4
    assert "cannot be written" in done.stderr
    assert names(out) == []


def test_progress_is_shown_on_a_terminal(tmp_path: Path) -> None:
    log = json_log(tmp_path / "in.mcap", 1000)
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [*RIOT, "edit", str(log), str(tmp_path / "out.mcap")], stderr=theirs, stdout=subprocess.DEVNULL, env=ENVIRONMENT
    )
    os.close(theirs)
    shown = b""
    try:
        while part := os.read(ours, 1000):
            shown += part
    except OSError:  # the other end is closed
        pass
    finally:
        os.close(ours)
    assert process.wait(60) == 0
    assert b"100%" in shown
    assert shown.endswith(b"\x1b[2K"), "the line is erased"
