from __future__ import annotations

import inspect
import subprocess
import sys

from riot_bus.vocabulary.flags import flags_of
from riot_bus_logtools.cli.diff import diff
from riot_bus_logtools.comparison.options import Extract


def test_riot_diff_has_all_of_them() -> None:
    assert {field.name for field, _, _ in flags_of(Extract)} <= inspect.signature(diff).parameters.keys()


def test_the_help_does_not_load_what_compares() -> None:
    compares = "'riot_bus_logtools.comparison.compare' in sys.modules"
    code = f"import sys, riot_bus_logtools.cli.diff; print('numpy' in sys.modules, {compares})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "False False\n"
