"""An edit holds a few chunks, however large the log is."""

import subprocess
import sys

import pytest

from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.vocabulary.message import Message

SCRIPT = """
import resource, sys
from pathlib import Path
from riot_bus_logtools.editing.edit import edit
from riot_bus_logtools.editing.options import EditOptions
inputs, output = [Path(each) for each in sys.argv[1].split(",")], Path(sys.argv[2])
edit(EditOptions(inputs=inputs[:1], output=output, duration=0.5, force=True, changes=["a:v = 1"]))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
result = edit(EditOptions(inputs=inputs, output=output, changes=["a:v = 1"], shifts=["b=0.1"], force=True))
print(result.total().kept, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


@pytest.mark.load
@pytest.mark.parametrize("count", [1, 3])
def test_memory_is_bounded(tmp_path, count):
    paths = [tmp_path / f"{n}.mcap" for n in range(count)]
    number, size = 60_000 // count, 4000
    for path in paths:
        with LogWriter(path, LogSettings(compression="none")) as writer:
            for n in range(number):
                payload = b'{"v": 0, "text": "%s"}' % (b"x" * size)
                writer.write(Message(10**9 + n * 10**6 * count, "ab"[n % 2], payload, encoding="application/json"))
    assert sum(path.stat().st_size for path in paths) > 240e6
    arguments = [",".join(map(str, paths)), str(tmp_path / "out.mcap")]
    done = subprocess.run([sys.executable, "-c", SCRIPT, *arguments], capture_output=True, text=True, check=True)
    kept, kilobytes = map(int, done.stdout.split())
    assert kept == number * count
    assert kilobytes < 80_000
