from __future__ import annotations

import inspect
import subprocess
import sys

from riot_bus.cli.diff import diff
from riot_bus.log.comparison.options import Extract
from riot_bus.vocabulary.flags import flags_of


def test_riot_diff_has_all_of_them() -> None:
    assert {field.name for field, _, _ in flags_of(Extract)} <= inspect.signature(diff).parameters.keys()


def test_the_help_does_not_load_what_compares() -> None:
    code = (
        "import sys, riot_bus.cli.diff; print('numpy' in sys.modules, 'riot_bus.log.comparison.compare' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "False False\n"
