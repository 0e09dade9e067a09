"""Create this checkout's own environment (.venv) and run something in it.

    python3 bootstrap.py demo [OPTIONS]           the demo on the embedded router
    python3 bootstrap.py test [OPTIONS]           the tests; --all: all of them; --changed: what a change concerns
    python3 bootstrap.py interop                  programs of others that some tests need; `test` does it first
    python3 bootstrap.py run COMMAND ...          any command of the environment, such as `ruff check`

Needs Python 3.11 or newer and nothing else. The environment is only built anew when pyproject.toml or requirements.lock
has changed. Where the latter knows Python and processor, exactly its files are installed, else the newest releases.
"""

import hashlib
import os
import platform
import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent
ENVIRONMENT = ROOT / ".venv"
BIN = ENVIRONMENT / "bin"
STAMP = ENVIRONMENT / "bootstrap.stamp"
LOCK = ROOT / "requirements.lock"
LOCKED_PYTHONS, LOCKED_MACHINES = ((3, 11), (3, 12), (3, 13)), ("x86_64", "aarch64")

FAILED, INTERRUPTED, NOTHING_COLLECTED = 1, 2, 5  # exit codes of pytest; the last one: no test of this phase is chosen
WAITING_WORKERS = 6  # integration tests mostly wait, so that more of them than processors run well together


def environment() -> None:
    """Create or refresh .venv with the project, its extras and the development tools."""
    files = (ROOT / "pyproject.toml").read_bytes() + LOCK.read_bytes()
    wanted = hashlib.sha256(files + sys.version.encode()).hexdigest()
    if STAMP.is_file() and STAMP.read_text() == wanted:
        return
    print(f"building {ENVIRONMENT} (once, about a minute)", file=sys.stderr, flush=True)
    pip = [str(BIN / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    if sys.version_info[:2] in LOCKED_PYTHONS and platform.machine() in LOCKED_MACHINES:
        # The lock is complete. Without --no-deps, pip before 25.1 fails as soon as something that is asked for with an
        # extra has a newer release. pip cannot check an editable installation, and a build of its own would fetch what
        # nobody has locked.
        project = ["--no-deps", "--no-build-isolation", "--editable", str(ROOT)]
        steps = [["--no-deps", "--require-hashes", "--requirement", str(LOCK)], project]
    else:
        print(f"{LOCK.name} does not know this Python or processor: the newest releases", file=sys.stderr, flush=True)
        project = ["--editable", f"{ROOT}[all]", "--group", f"{ROOT / 'pyproject.toml'}:dev"]
        steps = [["--upgrade", "pip>=25.1"], project]
    if subprocess.run([sys.executable, "-m", "venv", "--clear", str(ENVIRONMENT)], check=False).returncode:
        sys.exit(f"bootstrap.py: {sys.executable} -m venv failed (on Debian and Ubuntu: apt install python3-venv)")
    for step in steps:
        if code := subprocess.run([*pip, *step], check=False).returncode:
            sys.exit(f"bootstrap.py: {' '.join([*pip, *step])} failed with status {code}; what pip says stands above")
    STAMP.write_text(wanted)


def interop() -> int:
    """Provide the environments of other programs that tests talk to; return 1 if one cannot be had."""
    return subprocess.run([str(BIN / "python"), str(ROOT / "tests/interop.py")], check=False).returncode


def test(options: list[str]) -> int:
    """Run the tests in three phases, whatever the options are; return the worst exit code."""
    os.chdir(ROOT)
    # Images of containers set it. Each worker, and each of hundreds of processes, would compile all that it imports.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    everything = "--all" in options
    options = [each for each in options if each != "--all"]
    if everything:
        os.environ["RIOT_ALL_TESTS"] = "1"
    interop()
    pytest = [str(BIN / "python"), "-m", "pytest"]
    workers = len(os.sched_getaffinity(0))
    phases = [
        ["--phase=pure", f"-n{workers}", "--dist=worksteal"],
        ["--phase=processes", f"-n{max(WAITING_WORKERS, workers)}", "--dist=worksteal"],
        ["--phase=alone"],
    ]
    # Pytest ends itself in order, then we do. A background job of a shell ignores Ctrl-C, which tests would inherit.
    signal.signal(signal.SIGINT, lambda *_: None)
    codes = []
    for phase in phases:
        codes.append(subprocess.run([*pytest, *phase, *options], check=False).returncode)
        if codes[-1] == INTERRUPTED or (codes[-1] == FAILED and {"-x", "--exitfirst"} & set(options)):
            return codes[-1]
    return max((code for code in codes if code != NOTHING_COLLECTED), default=NOTHING_COLLECTED)


def main() -> None:
    """Carry out the command line."""
    if sys.version_info < (3, 11):  # noqa: UP036 - it is run by whatever Python there is
        sys.exit(f"bootstrap.py: riot_bus needs Python 3.11 or newer, this is {sys.version.split()[0]}")
    what, *rest = sys.argv[1:] or ["help"]
    if what not in ("demo", "test", "interop", "run"):
        sys.exit(__doc__)
    environment()
    os.environ["PATH"] = f"{BIN}{os.pathsep}{os.environ.get('PATH', '')}"
    if what == "test":
        sys.exit(test(rest))
    if what == "interop":
        sys.exit(interop())
    command = [str(BIN / "riot"), "demo", *rest] if what == "demo" else [str(BIN / rest[0]), *rest[1:]]
    os.execv(command[0], command)


if __name__ == "__main__":
    main()
