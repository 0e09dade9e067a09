"""Write requirements.lock: what bootstrap.py installs, with the SHA-256 of each file.

It asks pip what it would install for each Python and processor, and installs nothing. Run it with the oldest Python, as
pip takes markers of packages for those of the Python that runs it: what only newer ones need would be missing, which
bootstrap.py then says.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
LOCK = ROOT / "requirements.lock"
PYTHONS = ("3.11", "3.12", "3.13")
MACHINES = ("x86_64", "aarch64")
GLIBC = ("manylinux2014", *(f"manylinux_2_{minor}" for minor in range(17, 29)))
# `all` repeats the others, and `study` is much for few. antlr4-python3-runtime 4.7, which stl wants, has no wheel; pip
# resolves with wheels only.
UNLOCKED = ("all", "stl", "study")
BESIDE = ("editables", "pip")  # what hatchling needs for an editable installation, and what installs it
HEAD = """\
# What bootstrap.py installs, for Python 3.11 to 3.13 on Linux, x86_64 and aarch64.
# Written by `python3 bootstrap.py run python .ci/lock.py`; do not edit.
"""

Target = tuple[str, str]


def wanted(project: dict[str, Any]) -> list[str]:
    """Return the requirements of the project, of its extras (but UNLOCKED) and of its development."""
    extras: dict[str, list[str]] = project["project"]["optional-dependencies"]
    groups: dict[str, list[Any]] = project["dependency-groups"]
    texts = [*project["project"]["dependencies"], *project["build-system"]["requires"], *BESIDE]
    texts += [text for name, each in extras.items() if name not in UNLOCKED for text in each]
    texts += [text for each in groups["dev"] for text in groups[each["include-group"]]]
    return sorted(set(texts))


def resolved(requirements: Iterable[str], python: str, machine: str) -> list[tuple[str, str, str]]:
    """Return name, version and hash of all that pip would install."""
    options = ["--dry-run", "--ignore-installed", "--quiet", "--only-binary=:all:", "--report=-"]
    options += [f"--python-version={python}", "--implementation=cp"]
    options += [f"--abi={abi}" for abi in (f"cp{python.replace('.', '')}", "abi3", "none")]
    options += [f"--platform={glibc}_{machine}" for glibc in GLIBC]
    command = [sys.executable, "-m", "pip", "install", *options, *requirements]
    report = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    return [
        (
            re.sub(r"[-_.]+", "-", each["metadata"]["name"]).lower(),
            each["metadata"]["version"],
            each["download_info"]["archive_info"]["hashes"]["sha256"],
        )
        for each in report["install"]
    ]


def marker(targets: set[Target]) -> str:
    """Return where a release is wanted; empty if everywhere."""
    if len(targets) == len(PYTHONS) * len(MACHINES):
        return ""
    parts = []
    for python in PYTHONS:
        machines = [machine for machine in MACHINES if (python, machine) in targets]
        if machines == list(MACHINES):
            parts.append(f"python_version == '{python}'")
        else:
            parts += [f"(python_version == '{python}' and platform_machine == '{each}')" for each in machines]
    return f" ; {' or '.join(parts)}"


def main() -> None:
    """Write the file anew."""
    requirements = wanted(tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8")))
    targets: defaultdict[tuple[str, str], set[Target]] = defaultdict(set)
    hashes: defaultdict[tuple[str, str], set[str]] = defaultdict(set)
    for python in PYTHONS:
        for machine in MACHINES:
            for name, version, checksum in resolved(requirements, python, machine):
                targets[name, version].add((python, machine))
                hashes[name, version].add(checksum)
    lines = [
        " \\\n    ".join(
            [f"{name}=={version}{marker(targets[name, version])}", *(f"--hash=sha256:{each}" for each in found)]
        )
        for (name, version), found in sorted((key, sorted(each)) for key, each in hashes.items())
    ]
    LOCK.write_text(HEAD + "\n".join(lines) + "\n", encoding="utf-8")
    print(f"{LOCK.name}: {len(lines)} releases")


if __name__ == "__main__":
    main()
