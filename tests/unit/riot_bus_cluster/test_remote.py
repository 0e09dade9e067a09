"""What a worker gives back without a process, and which files of a trial."""

from __future__ import annotations

from pathlib import Path

import msgpack  # type: ignore[import-untyped]
import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_cluster import remote
from riot_bus_cluster.remote import serve
from riot_bus_cluster.workers import write_files


def test_what_goes_wrong_is_an_answer() -> None:
    found = msgpack.unpackb(serve(msgpack.packb({"do": "dance", "name": "a"})))
    assert "KeyError: 'dance'" in found["error"]


def test_to_end_what_is_not_there_is_nothing() -> None:
    assert msgpack.unpackb(serve(msgpack.packb({"do": "end", "name": "a"}))) == {}


def test_evidence_or_all_of_a_failing_run_comes_back_up_to_a_bound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "one.stdout").write_bytes(b"12345")
    assert remote._files(tmp_path) == {"files": {}, "left_out": 0}
    (tmp_path / "left").mkdir()
    (tmp_path / "left/trial.json").write_bytes(b"{}")
    (tmp_path / "left/link").symlink_to("/etc/passwd")
    assert remote._files(tmp_path) == {"files": {"left/trial.json": b"{}"}, "left_out": 0}
    (tmp_path / "external.mcap").write_bytes(b"log")
    whole = {"external.mcap": b"log", "left/trial.json": b"{}", "one.stdout": b"12345"}
    assert remote._files(tmp_path)["files"] == whole
    monkeypatch.setattr(remote, "MOST_FILES", 9)
    assert remote._files(tmp_path) == {"files": {}, "left_out": 10}


def test_a_recording_is_one_file(tmp_path: Path) -> None:
    (tmp_path / "left").write_bytes(b"log")
    assert remote._files(tmp_path)["files"] == {"left": b"log"}


@pytest.mark.parametrize("name", ["/etc/cron.d/x", "../x", "left/../../x", ""])
def test_no_file_leaves_the_folder_of_its_trial(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "trial"
    with pytest.raises(ConfigError, match="has sent a file named"):
        write_files(folder, {name: b""})
    write_files(folder, {"left/a.txt": b"1"})
    assert (folder / "left/a.txt").read_bytes() == b"1"
