"""Builds the distribution of riot-bus, and installs it where nothing but its dependencies is."""

from __future__ import annotations

import importlib.metadata
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
NAME = "riot-bus"


def build(source: Path, target: str, folder: Path) -> Path:
    """Build one distribution of a source tree and return its file."""
    before = set(folder.glob("*"))
    run(Path(sys.executable), "-m", "hatchling", "build", "--target", target, "--directory", folder, cwd=source)
    (made,) = set(folder.glob("*")) - before
    return made


def install(wheel: Path, folder: Path, *, extras: tuple[str, ...]) -> Path:
    """Install a wheel where nothing but its dependencies is, and return the folder of its programs.

    The dependencies are links to those of the environment that runs the tests, so no network is needed.

    Args:
        wheel: The file.
        folder: For the environment.
        extras: Those to install with it.
    """
    run(Path(sys.executable), "-m", "venv", "--without-pip", folder)
    (packages,) = folder.glob("lib/python*/site-packages")
    for name in dependencies(extras):
        found = importlib.metadata.distribution(name)
        for top in {each.parts[0] for each in found.files or ()} - {"..", "__pycache__", *os.listdir(packages)}:
            (packages / top).symlink_to(str(found.locate_file(top)))
    pip = ("-m", "pip", "--python", folder / "bin/python", "install", "--quiet", "--no-deps", "--no-index")
    run(Path(sys.executable), *pip, wheel)
    return folder / "bin"


def without_extensions(programs: Path) -> Path:
    """Take the extensions out of an environment, and their entry points; what stays is the core alone."""
    (packages,) = programs.parent.glob("lib/python*/site-packages")
    extensions = [each.name for each in (ROOT / "extensions").iterdir() if (each / "__init__.py").exists()]
    for name in extensions:
        shutil.rmtree(packages / name)
    (points,) = packages.glob("riot_bus-*.dist-info/entry_points.txt")
    theirs = re.compile(rf"^\S+ = ({'|'.join(extensions)})[.:].*\n", re.MULTILINE)
    text, count = theirs.subn("", points.read_text())
    assert count >= len(extensions)
    points.write_text(text)
    return programs


def dependencies(extras: tuple[str, ...]) -> set[str]:
    """Return the names of all distributions that riot-bus with some extras asks for, directly or not."""
    found: set[tuple[str, frozenset[str]]] = set()
    open_ones = [(NAME, frozenset(extras))]
    while open_ones:
        name, chosen = open_ones.pop()
        if (name, chosen) in found:
            continue
        found.add((name, chosen))
        for text in importlib.metadata.requires(name) or ():
            needed = Requirement(text)
            if needed.marker is None or any(needed.marker.evaluate({"extra": extra}) for extra in ("", *chosen)):
                open_ones.append((needed.name, frozenset(needed.extras)))
    return {name for name, _ in found} - {NAME}


def run(program: Path, *arguments: object, cwd: Path = Path("/")) -> str:
    """Run a program to its successful end; return what it printed."""
    code, out, err = outcome(program, *arguments, cwd=cwd)
    assert code == 0, out + err
    return out


def outcome(program: Path, *arguments: object, cwd: Path = Path("/")) -> tuple[int, str, str]:
    """Run a program; return its exit code, and what it printed to stdout and stderr."""
    command = [str(program), *map(str, arguments)]
    done = subprocess.run(command, cwd=cwd, env={"HOME": "/nonexistent"}, capture_output=True, text=True, timeout=120)
    return done.returncode, done.stdout, done.stderr
