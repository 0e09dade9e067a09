"""Create this checkout's own environment (.venv) and run something in it.

    python3 bootstrap.py demo [OPTIONS]     the demo on the embedded router
    python3 bootstrap.py test [OPTIONS]     the tests (OPTIONS go to pytest)
    python3 bootstrap.py run COMMAND ...    any command of the environment, such as `ruff check`

Needs Python 3.11 or newer and nothing else. The environment is only built anew when pyproject.toml has changed.
"""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent
ENVIRONMENT = ROOT / ".venv"
BIN = ENVIRONMENT / "bin"
STAMP = ENVIRONMENT / "bootstrap.stamp"


def environment() -> None:
    """Create or refresh .venv with the project, all extras and the development tools."""
    wanted = hashlib.sha256((ROOT / "pyproject.toml").read_bytes() + sys.version.encode()).hexdigest()
    if STAMP.is_file() and STAMP.read_text() == wanted:
        return
    print(f"building {ENVIRONMENT} (once, about a minute)", file=sys.stderr, flush=True)
    pip = [str(BIN / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    try:
        subprocess.run([sys.executable, "-m", "venv", "--clear", str(ENVIRONMENT)], check=True)
        subprocess.run([*pip, "--upgrade", "pip>=25.1"], check=True)
        subprocess.run([*pip, "--editable", f"{ROOT}[all]", "--group", f"{ROOT / 'pyproject.toml'}:dev"], check=True)
    except subprocess.CalledProcessError as error:
        command = " ".join(map(str, error.cmd))
        sys.exit(f"bootstrap.py: {command} failed (on Debian and Ubuntu: apt install python3-venv)")
    STAMP.write_text(wanted)


def main() -> None:
    """Carry out the command line."""
    if sys.version_info < (3, 11):  # noqa: UP036 - it is run by whatever Python there is
        sys.exit(f"bootstrap.py: riot_bus needs Python 3.11 or newer, this is {sys.version.split()[0]}")
    what, *rest = sys.argv[1:] or ["help"]
    if what not in ("demo", "test", "run"):
        sys.exit(__doc__)
    environment()
    os.environ["PATH"] = f"{BIN}{os.pathsep}{os.environ.get('PATH', '')}"
    pytest = [str(BIN / "python"), "-m", "pytest"]
    if what == "test":
        os.chdir(ROOT)
        # Whole chains are timed by the systems they run: they get the machine to themselves.
        phases = [[*pytest, *rest]] if rest else [[*pytest, "-n", "auto", "-m", "not e2e"], [*pytest, "-m", "e2e"]]
        sys.exit(max(subprocess.run(phase, check=False).returncode for phase in phases))
    command = [str(BIN / "riot"), "demo", *rest] if what == "demo" else [str(BIN / rest[0]), *rest[1:]]
    os.execv(command[0], command)


if __name__ == "__main__":
    main()
