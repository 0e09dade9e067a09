"""What commands execute of what strangers made: SECURITY.md's table, held by canaries in each place that could run."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
import typer.main

from riot_bus.cli.main import make_app
from riot_bus.findings.known import KnownFinding, KnownFindings
from riot_bus.findings.records import CampaignRecord, FindingRecord
from riot_bus_mavlink.tlog import tlog_record
from tests.unit.chain.machine import SPEED, bench, write_fields, write_minimal, write_rule
from tests.unit.cli.test_reference import commands

ROOT = Path(__file__).parents[2]
TABLE = re.compile(r"^\| (`.*?) \| [^|]* \| [^|]* \| (nothing|yours)[^|]* \|$", re.MULTILINE)
NOTHING = "nothing"

CANARY = "import sys\nopen({ran!r}, 'a').write(f'{{__file__}} in {{sys.argv}}\\n')\n"
SHADOWS = ("sitecustomize", "usercustomize", "json", "numpy", "yaml", "zenoh", "conftest", "evil", "m")
"""Modules of a stranger's folder: those that Python loads by itself, that shadow others, and that riot.toml names."""
SYSTEM = """
[system]
types = {{"command" = "json"}}
[components.panel]
command = ["{engine}", "command of panel"]
external = true
outputs = ["panel"]
[components.drive]
command = ["{engine}", "command of drive"]
setup = ["{engine}", "setup"]
teardown = ["{engine}", "teardown"]
stop = ["{engine}", "stop"]
ready = {{command = ["{engine}", "ready"]}}
inputs = ["command"]
[components.box]
container = {{image = "box", engine = "{engine}"}}
[external]
topics = ["panel"]
[[monitors]]
kind = "m.py"
[router]
interceptors = [{{use = "evil.py"}}]
[unit.drive]
dictionaries = ["dictionary.toml"]
"""
OWN = '[components.drive]\ncommand = ["false"]\ninputs = ["command"]\n[unit.drive]\n'
GROUPS = ("steps", "adapters", "codecs", "interceptors", "monitors", "faults", "search", "reports", "bridges")
"""Groups of entry points by which a package in that folder would be found, if Python looked there."""

DEAD = "tcp/127.0.0.1:1"
"""Where nobody listens: commands of a network have read all that they read of files when they find out."""
CTL = {
    **dict.fromkeys(("status", "counts", "plan clear"), ""),
    **{f"record {word}": "" for word in ("start", "stop", "split", "status", "pause", "resume", "dump")},
    **{f"play {word}": "" for word in ("status", "pause", "resume", "stop", "step")},
    **dict.fromkeys(("intercept add", "intercept remove"), "x"),
    **{"plan load": "{theirs}/plan.toml", "play seek": "1", "play rate": "1"},
}
FLEET = {
    **dict.fromkeys(("record", "status", "pause", "resume", "stop", "logs"), "r"),
    **{"robots": "", "play": "r log.mcap --inject {theirs}/plan.toml", "seek": "r 1", "rate": "r 1"},
}
FORMATS = ("text", "html", "sarif", "github")
LINES: dict[str, tuple[str, ...]] = {
    "report": (
        *(f"{{out}} --format {name}" for name in FORMATS),
        "{finding} --format markdown",
        "{out} --format junit --baseline {theirs}/riot-baseline.json",
    ),
    "findings": ("{out}",),
    "trials": ("{out}",),
    "compare": ("{out} {out}",),
    "ci accept": ("{finding} --keep kept --baseline b.json", "{finding} --baseline {theirs}/riot-baseline.json"),
    "predict": ("{log} {finding}",),
    "scan": (
        "{log} --rule {finding}",
        "{log} --rule {finding}/rule.json --page page.html",
        f"--watch --rule {{out}} -e {DEAD}",
    ),
    "guard": ("{finding}", "{out} --action clamp"),
    "backchain": ("{log} --to {finding}", "{log} --to command:speed --system {theirs}/riot.toml"),
    "info": ("{log}", "{theirs}", "{log} --msg {theirs}/evil.py"),
    "types": ("{log}", "Odometry"),
    "show": ("{log}", "{finding}"),
    "export": ("{log} --field command:speed --out out.csv --force",),
    "import": ("{theirs}/log.tlog out.mcap",),
    "diff": ("{log} {out}/nominal.mcap", "{log} {log} --tolerances {theirs}/plan.toml"),
    "edit": ("{log} out.mcap --force --inject {theirs}/plan.toml",),
    "play": (f"{{log}} -e {DEAD} --inject {{theirs}}/plan.toml", f"{{log}} -e {DEAD} --expect {{log}}"),
    "dict list": ("", "--system {theirs}/riot.toml"),
    "dict show": ("{theirs}/dictionary.toml", "{theirs}/dictionary.toml --log {log} --system {theirs}/riot.toml"),
    "dict validate": ("{theirs}/dictionary.toml", "{theirs}/dictionary.toml --log {log}"),
    "dict schema": ("",),
    "interceptors": ("",),
    "ci init": ("--github --force",),
    "agent acl": ("viewer",),
    "fleet index": ("{theirs} --catalogue c.sqlite",),
    "fleet list": ("--catalogue {catalogue}",),
    "fleet show": ("{log} --catalogue {catalogue}",),
    "init": (f"-e {DEAD} -o new.toml", "--log {log} -o new.toml"),
    "graph": (f"-e {DEAD}",),
    "doctor": ("--no-scouting",),
    "agent": (f"--logs {{theirs}} -e {DEAD} --fleet-cfg x={{theirs}}/plan.toml",),
    "record": (f"-e {DEAD} -o out.mcap",),
    **{f"ctl {name}": (more,) for name, more in CTL.items()},
    **{f"fleet {name}": (f"{more} -e {DEAD}",) for name, more in FLEET.items()},
    # steps and the rest: in a folder without riot.toml, then in one with the user's own
    **dict.fromkeys(("minimize", "relevance", "rules", "permeability", "activate", "reproduce"), ("{finding}",)),
    "step": ("evil {finding}",),
    "fleet run": tuple(f"{each} --over '' --catalogue {{catalogue}}" for each in ("{finding}", "{theirs}/plan.toml")),
    "test": ("--out {out} --trials 1",),
    "analyze": ("--out {out} --trials 1",),
    "ci change": ("--out {out} --baseline {theirs}/riot-baseline.json --minutes 0.1",),
    "ci batch": ("--out {out} --baseline {theirs}/riot-baseline.json --minutes 0.1",),
    "ci prune": ("--out {out} --baseline {theirs}/riot-baseline.json",),
    "demo": ("--out {out} --budget 1 --system riot.toml",),
    "cluster check": ("dask://127.0.0.1:1",),
    "exec": ("--segment system -- true",),
    "ros-test": ("--inject {theirs}/plan.toml -- true",),
    "router": ("--inject {theirs}/none.toml",),
    "router env": ("system",),
    "bridge mavlink": (f"-e {DEAD} --link udpout:127.0.0.1:1 --xml {{theirs}}/evil.py",),
    "bridge ros2": (f"-e {DEAD} --python false",),
}  # fmt: skip
"""Arguments by command."""
OF_THE_NETWORK = {"agent", "graph", "doctor", "record", *(f"ctl {name}" for name in CTL)}
OF_THE_NETWORK |= {f"fleet {name}" for name in FLEET}
OF_THE_NETWORK -= {"ctl plan load", "fleet play"}
"""Commands that are given nothing of a stranger's; they may only be called in such a folder."""


class Stranger(NamedTuple):
    """A folder that somebody else has made, and the file in which whatever of it runs leaves a line."""

    theirs: Path
    ran: Path

    def run(self, command: str, line: str, cwd: Path) -> subprocess.CompletedProcess[str]:
        places = {
            "theirs": self.theirs, "out": self.theirs / "out", "log": self.theirs / "log.mcap",
            "finding": self.theirs / "out/findings/hang-drive-1", "catalogue": self.ran.parent / "c.sqlite",
            "own": self.ran.parent / "home",
        }  # fmt: skip
        words = shlex.split(line.format(**{name: shlex.quote(str(path)) for name, path in places.items()}))
        called = [*command.split(), *words]
        if called[0] == "ctl":
            called[1:1] = ["-e", DEAD]
        environment = {
            name: value for name, value in os.environ.items() if not name.startswith(("RIOT_", "GITHUB_", "PYTHONPATH"))
        }
        environment |= {"PYTHONPATH": str(ROOT), "HOME": str(self.ran.parent / "home"), "TMPDIR": str(self.ran.parent)}
        return subprocess.run(
            [sys.executable, "-P", "-m", "riot_bus", *called], cwd=cwd, env=environment, capture_output=True, text=True,
            timeout=240, check=False, stdin=subprocess.DEVNULL,
        )  # fmt: skip


@pytest.fixture(scope="module")
def stranger(tmp_path_factory: pytest.TempPathFactory) -> Stranger:
    place = tmp_path_factory.mktemp("strangers")
    made = Stranger(place / "bug-77", place / "RAN")
    made.theirs.mkdir()
    (place / "home").mkdir()
    one = bench(made.theirs)
    write_minimal(one)
    write_rule(one)
    write_fields(one, SPEED)
    one.workspace.nominal_log()
    one.workspace.store.close()
    injected = {"topic": "command", "field": "speed", "value": -5.0}
    record = FindingRecord.load(one.folder).model_copy(
        update={"system_file": "../../../riot.toml", "injections": (injected,)}
    )
    record.save(one.folder)
    CampaignRecord(unit="drive", fingerprint="x", findings=(one.folder.name,)).save(made.theirs / "out")
    entry = KnownFinding.of(record, log=str(one.folder.relative_to(made.theirs)))
    KnownFindings(made.theirs / "riot-baseline.json").updated([entry]).save()
    for name in ("out/findings/hang-drive-1/failure.mcap", "log.mcap"):
        shutil.copyfile(one.folder / "minimal.mcap", made.theirs / name)
    (made.theirs / "log.tlog").write_bytes(tlog_record(10**18, bytes([254, 9, 0, 1, 1, 0, *range(11)])))
    (made.theirs / "plan.toml").write_text('[[inject]]\ntopic = "command"\nfield = "speed"\nvalue = 1.0\n')
    (made.theirs / "dictionary.toml").write_text('[[entry]]\ntype = "float64"\nvalue = 1.0\nreason = "x"\n')

    engine = made.theirs / "engine"
    engine.write_text(f'#!/bin/sh\necho "engine $*" >> {shlex.quote(str(made.ran))}\nsleep 1\n')
    engine.chmod(0o755)
    (made.theirs / "riot.toml").write_text(SYSTEM.format(engine=engine))
    for folder in (made.theirs, made.theirs / "out", one.folder):
        for name in SHADOWS:
            (folder / f"{name}.py").write_text(CANARY.format(ran=str(made.ran)))
    with (made.theirs / "m.py").open("a") as monitor:
        monitor.write("class M:\n    topics = ()\n    def judge(self, view): return []\n")
    info = made.theirs / "evil-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: evil\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("".join(f"[riot_bus.{group}]\nevil = evil:EVIL\n" for group in GROUPS))
    assert made.run("fleet index", "{theirs} --catalogue {catalogue}", place).returncode == 0
    return made


def promised() -> dict[str, str]:
    """Return for each command what SECURITY.md says that it executes of what strangers made."""
    text = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
    found = [(name, what) for names, what in TABLE.findall(text) for name in re.findall(r"`([^`]+)`", names)]
    assert len(found) == len(dict(found)), "a command stands in two rows"
    return dict(found)


def all_commands() -> set[str]:
    found = {
        name.removeprefix("riot").strip(): each for name, each in commands(typer.main.get_command(make_app()), "riot")
    }
    runs = {name for name, each in found.items() if not hasattr(each, "list_commands") or each.invoke_without_command}
    return runs - {""} | {"step"}


def test_each_command_stands_in_the_table_and_is_tried() -> None:
    assert set(promised()) == set(LINES) == all_commands()


@pytest.mark.integration
@pytest.mark.parametrize(
    "command", [pytest.param(one, marks=pytest.mark.nightly if one in OF_THE_NETWORK else ()) for one in sorted(LINES)]
)
def test_nothing_of_a_stranger_s_folder_is_executed(stranger: Stranger, tmp_path: Path, command: str) -> None:
    """Commands that execute nothing work in that folder itself; others where there is no riot.toml, then the user's."""
    safe = promised()[command] == NOTHING
    stranger.ran.unlink(missing_ok=True)  # of another test that has failed
    for line in LINES[command]:
        for toml in ("",) if safe else ("", OWN):
            (tmp_path / "riot.toml").unlink(missing_ok=True)
            if toml:
                (tmp_path / "riot.toml").write_text(toml)
            done = stranger.run(command, line, stranger.theirs if safe else tmp_path)
            assert "Traceback" not in done.stderr, (line, done.stderr)
            assert not stranger.ran.exists(), (line, stranger.ran.read_text())
            assert "Usage:" not in done.stderr or command == "step", (line, done.stderr)


@pytest.mark.integration
def test_the_canaries_sing_where_the_riot_toml_of_that_folder_is_the_user_s_choice(stranger: Stranger) -> None:
    stranger.run("test", "--trials 1 --out {own}/out", stranger.theirs)
    told = stranger.ran.read_text()
    stranger.ran.unlink()
    assert "m.py in" in told
    assert "engine setup" in told
