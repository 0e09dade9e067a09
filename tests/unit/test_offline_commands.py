"""Commands that need no router import nothing of the live half, so they start fast and work where Zenoh does not."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.message import Message
from riot_bus_mavlink.tlog import tlog_record
from tests.unit.riot_bus_bridges.mavlink.frames import frame_of

LIVE = ("agent", "bridge", "control", "doctor", "graph", "play", "record", "router", "zenoh")
PROGRAM = f"""
import sys
from riot_bus.cli.main import run
sys.argv[0] = "riot"
try:
    run()
finally:
    live = [name for name in sys.modules if name.split(".")[:2] in [["riot_bus", room] for room in {LIVE!r}]]
    print("LIVE", live + [name for name in ("zenoh",) if name in sys.modules], file=sys.stderr)
"""


@pytest.fixture
def log(tmp_path: Path) -> Path:
    with LogWriter(tmp_path / "in.mcap") as writer:
        for number in range(5):
            writer.write(Message(10**9 + number, "a", b'{"x": 1}', encoding="application/json"))
    (tmp_path / "in.tlog").write_bytes(b"".join(tlog_record(10**18, frame_of(sequence=n).raw) for n in range(5)))
    (tmp_path / "campaign.json").write_text('{"unit": "u", "fingerprint": "f"}')
    return tmp_path / "in.mcap"


@pytest.mark.parametrize(
    "arguments",
    [
        ["info", "{log}", "--fields"],
        ["types", "{log}"],
        ["export", "{log}", "--field", "a:x", "-o", "{out}.csv"],
        ["diff", "{log}", "{log}", "--html", "{out}.html"],
        ["edit", "{log}", "{out}.mcap", "--set", "a:x = 2", "--interceptor", "drop every=2"],
        ["init", "--mavlink", "{folder}/in.tlog?rate=0", "--seconds", "0.5", "-o", "{out}.toml"],
        ["findings", "{folder}"],
        ["interceptors"],
        ["dict", "show", "float64", "--log", "{log}"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_it_imports_nothing_of_the_live_half(arguments: list[str], log: Path, tmp_path: Path) -> None:
    given = [each.format(log=log, out=tmp_path / "out", folder=tmp_path) for each in arguments]
    done = subprocess.run([sys.executable, "-c", PROGRAM, *given], capture_output=True, text=True, check=False)
    assert done.stderr.splitlines()[-1] == "LIVE []", done.stderr[-2000:]
    assert done.returncode == 0, done.stderr
