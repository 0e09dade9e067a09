"""The script that runs a finding again."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from pathlib import Path

__all__ = ["SCRIPT", "write_reproduce"]

SCRIPT = "reproduce.sh"


def write_reproduce(directory: Path, *, arguments: Sequence[str] = ()) -> Path:
    """Write `reproduce.sh`, which runs `riot reproduce` on the directory that it lies in, wherever that was moved.

    Args:
        directory: The finding's directory.
        arguments: Further arguments of `riot reproduce`; those given to the script follow them.
    """
    path = directory / SCRIPT
    fixed = "".join(f" {shlex.quote(argument)}" for argument in arguments)
    line = f'exec riot reproduce "$(cd -- "$(dirname -- "$0")" && pwd)"{fixed} "$@"'
    partial = path.with_suffix(".partial")
    partial.write_text(f"#!/bin/sh\n{line}\n", encoding="utf-8")
    partial.chmod(0o755)
    os.replace(partial, path)
    return path
