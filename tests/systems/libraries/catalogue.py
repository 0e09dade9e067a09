"""Systems of one thin node each (`node.py`) and their nominal logs; `write` makes one of them."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Any

from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.message import Message

__all__ = ["INPUTS", "write"]

FOLDER = Path(__file__).resolve().parent
INPUTS = {
    "planner": ("map", "query"),
    "ida_planner": ("map", "query"),
    "controller": ("tuning", "measured"),
    "tracker": ("position",),
    "unscented": ("position",),
    "navigator": ("home", "fix"),
}
"""The topics that each kind reads."""

_ROUNDS = 30
_STEP_NS = 100_000_000
_WIDTH, _HEIGHT = 6, 4


def write(folder: Path, kind: str, python: Path) -> Path:
    """Write riot.toml, the nominal log and the program of a kind into a folder; return the path of the former."""
    shutil.copy(FOLDER / "node.py", folder)
    with LogWriter(folder / "nominal.mcap") as log:
        for number in range(_ROUNDS):
            for order, (key, values) in enumerate(_messages(kind, number)):
                time = 10**18 + number * _STEP_NS + order
                log.write(Message(time, key, json.dumps(values).encode(), encoding="application/json"))
    path = folder / "riot.toml"
    path.write_text(
        f'[system]\nname = "{kind}"\nnominal = "nominal.mcap"\n'
        f'[components.{kind}]\ncommand = ["{python}", "node.py", "{kind}", "{{endpoint}}"]\n'
        f'inputs = {json.dumps(INPUTS[kind])}\noutputs = ["answer"]\nready = {{ timeout = 60 }}\n'
        f"[unit.{kind}]\nsettle = {{ timeout = 3.0 }}\n"
    )
    return path


def _messages(kind: str, number: int) -> list[tuple[str, dict[str, Any]]]:
    """Return the messages of one round."""
    wave = math.sin(number / 5)
    if kind in ("planner", "ida_planner"):
        cells = [[1] * _WIDTH for _ in range(_HEIGHT)]
        cells[1][1 + number // 10] = 0
        query = {"x0": 0, "y0": 0, "x1": _WIDTH - 1, "y1": 0 if number % 2 else _HEIGHT - 1}
        return [*([("map", {"cells": cells})] if number % 10 == 0 else []), ("query", query)]
    if kind == "controller":
        tuning = {"setpoint": 20.0 + number, "kp": 1.5, "ki": 0.5, "kd": 0.1, "low": 0.0, "high": 100.0}
        return [*([("tuning", tuning)] if number % 10 == 0 else []), ("measured", {"value": 18.0 + wave, "dt": 0.1})]
    if kind == "tracker":
        return [("position", {"z": 3.0 + wave, "variance": 0.5})]
    if kind == "unscented":
        return [("position", {"z": 3.0 + wave, "variance": 0.5, "dt": 0.1})]
    home = {"lat": 47.3977, "lon": 8.5456, "alt": 488.0}
    fix = {"lat": 47.3977 + 1e-4 * wave, "lon": 8.5456 + 1e-5 * number, "alt": 490.0 + wave}
    return [*([("home", home)] if number % 10 == 0 else []), ("fix", fix)]
