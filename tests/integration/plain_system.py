"""A plain Zenoh system of three processes, for tests of `riot init`."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from riot_bus.zenoh.session import environment_of_others

NODE = Path(__file__).parents[1] / "systems/plain_node.py"


@contextlib.contextmanager
def plain_system(
    folder: Path, words: Mapping[str, Sequence[str]], environment: Mapping[str, str] | None = None
) -> Iterator[dict[str, int]]:
    """Run `node.py ROLE WORDS...` for each role in a folder, until all are ready; yields their process ids."""
    shutil.copy(NODE, folder / "node.py")
    usual = {
        name: value for name, value in environment_of_others().items() if not name.startswith(("ZENOH_", "KMP_"))
    }  # scikit-learn sets some
    with contextlib.ExitStack() as stack:
        pids = {}
        for role, more in words.items():
            process = stack.enter_context(
                subprocess.Popen(
                    [sys.executable, "node.py", role, *more],
                    cwd=folder,
                    stdout=subprocess.PIPE,
                    text=True,
                    env={**usual, **(environment or {})},
                )
            )
            stack.callback(process.kill)
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            pids[role] = process.pid
        yield pids
