"""Programs of others that tests talk to: each in an environment of its own, provided before the tests run.

`python3 bootstrap.py test` runs this file as a program, which installs what is missing into this user's cache folder.
Tests only look (`require`): what is not there is skipped, and said once at the end of the run. With
RIOT_REQUIRE_INTEROP=1 a test that lacks its environment fails instead.
"""

from __future__ import annotations

import fcntl
import functools
import hashlib
import os
import shutil
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

__all__ = ["ENVIRONMENTS", "QUICK", "Environment", "importable", "of_case", "provide", "require"]

_INSTALL_S = 600
_FOREIGN = ("PYTHON", "ROS_", "RMW_", "AMENT_")


@dataclass(frozen=True, slots=True)
class Environment:
    """Packages that tests need and that cannot live beside riot_bus.

    Attributes:
        name: Name of the folder, and what the summary calls it.
        packages: Requirements for pip, or packages of npm.
        check: Python statement that works when all is there; empty for packages of npm.
        pythons: Versions of Python that there are wheels for; empty for this one.
        options: Further options of pip.
    """

    name: str
    packages: tuple[str, ...]
    check: str = ""
    pythons: tuple[str, ...] = ()
    options: tuple[str, ...] = ("--prefer-binary",)

    @property
    def python(self) -> str | None:
        """Python that the environment is made with; None if this machine has none that fits."""
        versions = self.pythons or (".".join(map(str, sys.version_info[:2])),)
        return next(filter(None, map(_python, versions)), None)

    @property
    def folder(self) -> Path:
        """This user's folder for it: another one when what is asked for changes."""
        contents = repr((self.python, self.packages)).encode()
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "riot-bus-tests"
        return own_folder(cache / f"{self.name}-{hashlib.sha256(contents).hexdigest()[:12]}")

    @property
    def entry(self) -> Path:
        """Its interpreter; for packages of npm the folder itself."""
        return self.folder / "venv/bin/python" if self.check else self.folder

    @property
    def complete(self) -> bool:
        """Whether it is there."""
        return (self.folder / "complete").exists() and self.entry.exists()


ROS2 = Environment(
    "rclpy",
    (
        "ros-rclpy[fastrtps]==9.1.2",
        "ros-std-msgs",
        "ros-sensor-msgs",
        "ros-nav-msgs",
        "ros-std-srvs",
        "ros-test-msgs",
        "numpy>=1.26",
    ),
    "import rclpy, nav_msgs.msg, sensor_msgs.msg, std_srvs.srv, test_msgs.action",
    pythons=("3.11", "3.12"),
)
"""Its wheels change how every Python of their environment starts, so they cannot live beside riot_bus."""

MAVLINK = Environment(
    "mavlink",
    ("MAVProxy==1.8.75", "mavsdk==4.1.0", "dronekit==2.9.2", "pymavlink==2.4.50", "future>=1.0"),
    "import MAVProxy, mavsdk, pymavlink, past",
)
SDK = Environment(
    "zenoh-ros2-sdk",
    ("zenoh-ros2-sdk==0.1.8",),
    "import zenoh_ros2_sdk",  # needs git
    options=("--only-binary=:all:",),
)
LIBRARIES = Environment(
    "libraries",
    (
        "pathfinding==1.0.23",
        "simple-pid==2.0.1",
        "filterpy==2.0.0",
        "pymap3d==3.2.0",
        "numpy==2.4.6",
        "scipy==1.17.1",
        "eclipse-zenoh==1.10.2",
    ),
    "import filterpy.kalman, pathfinding, pymap3d, simple_pid, zenoh",
    options=("--only-binary=:all:",),
)
"""What the nodes of `examples/localisation` are made of."""
FOXGLOVE = Environment(
    "foxglove", ("@mcap/core@2.2.2", "@foxglove/rosmsg@5.0.5", "@foxglove/rosmsg2-serialization@3.1.0", "fzstd@0.1.1")
)
RTAMT = Environment("rtamt", ("rtamt==0.4.10",), "import rtamt", pythons=("3.11", "3.12"))
"""Its parser has no wheel, so requirements.lock cannot have it; tests put it on their own path (`importable`)."""
OPTUNA = Environment("optuna", ("optuna==5.0.0",), "import optuna", options=("--only-binary=:all:",))
"""Much for few, so requirements.lock has it not; tests put its folder on their own path, too."""
MKDOCS = Environment("mkdocs", ("mkdocs-material==9.8.2",), "import material", options=("--only-binary=:all:",))
"""What builds the site of the documentation."""
CASES = Path(__file__).resolve().parents[1] / "benchmarks/real_faults/cases"


def of_case(folder: Path, *, twin: bool = False, more: tuple[str, ...] = ()) -> Environment:
    """Return the environment of a real fault's program, or of its twin, with more packages."""
    case = tomllib.loads((folder / "case.toml").read_text(encoding="utf-8"))
    packages = case.get("twin") if twin and case.get("twin") else case["packages"]
    zenoh = () if any(each.startswith("eclipse-zenoh") for each in packages) else ("eclipse-zenoh==1.10.2",)
    return Environment(f"case-{folder.name}", (*packages, *zenoh, *more), "import zenoh")


QUICK = tuple(CASES / name for name in ("pyais", "pynmea2", "utm"))
"""The real faults that each run of the tests checks; `benchmarks/real_faults` has the others."""
CASE_ENVIRONMENTS = tuple(dict.fromkeys(of_case(case, twin=twin) for case in QUICK for twin in (False, True)))
ENVIRONMENTS = (ROS2, MAVLINK, SDK, LIBRARIES, FOXGLOVE, RTAMT, OPTUNA, MKDOCS, *CASE_ENVIRONMENTS)


def require(environment: Environment) -> Path:
    """Return an environment's interpreter (of npm: its folder); without it the test is skipped, or fails if told so."""
    import pytest

    if not environment.complete:
        reason = _failure(environment) or "run python3 bootstrap.py interop"
        end = pytest.fail if os.environ.get("RIOT_REQUIRE_INTEROP") else pytest.skip
        end(f"NOT TESTED: {environment.name}: {reason}")
    return environment.entry


def importable(environment: Environment, package: str) -> None:
    """Make a package of an environment importable here; without it the test is skipped, or fails if told so."""
    if find_spec(package) is None:
        (folder,) = require(environment).parents[1].glob("lib/python*/site-packages")
        sys.path.append(str(folder))


def provide(environment: Environment) -> str:
    """Install an environment unless it is there; return why it cannot be had, or an empty text."""
    if environment.python is None:
        return f"needs Python {' or '.join(environment.pythons)}"
    folder = environment.folder
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if environment.complete:
            return ""
        print(f"installing {environment.name} for the tests, once", file=sys.stderr, flush=True)
        problem = next(filter(None, (_run(command, folder) for command in _commands(environment))), "")
        (folder / ("failed" if problem else "complete")).write_text(problem)
    return problem


def own_folder(folder: Path) -> Path:
    """Create a folder that only this user can enter; raises PermissionError if somebody else has it."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if folder.is_symlink() or folder.stat().st_uid != os.getuid():
        raise PermissionError(f"{folder} belongs to somebody else")
    return folder


def _commands(environment: Environment) -> list[list[str]]:
    if not environment.check:
        return [
            ["npm", "install", "--no-audit", "--no-fund", "--ignore-scripts", "--prefix", ".", *environment.packages]
        ]
    python = str(environment.entry)
    pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--retries=1"]
    return [
        [environment.python or "", "-m", "venv", "--clear", str(environment.folder / "venv")],
        [*pip, *environment.options, *environment.packages],
        [python, "-c", environment.check],
    ]


def _run(command: list[str], folder: Path) -> str:
    kept = {key: value for key, value in os.environ.items() if not key.startswith(_FOREIGN)}
    short = " ".join(command[:4])
    try:
        done = subprocess.run(
            command, cwd=folder, env=kept, capture_output=True, text=True, timeout=_INSTALL_S, check=False
        )
    except (subprocess.TimeoutExpired, OSError) as error:
        return f"{short}: {error}"
    lines = [line for line in (done.stdout + done.stderr).splitlines() if not line.startswith("WARNING")]
    return f"{short}: {lines[-1] if lines else done.returncode}" if done.returncode else ""


def _failure(environment: Environment) -> str:
    if environment.python is None:
        return f"needs Python {' or '.join(environment.pythons)}"
    failed = environment.folder / "failed"
    return failed.read_text() if failed.exists() else ""


@functools.cache
def _python(version: str) -> str | None:
    if sys.version_info[:2] == tuple(map(int, version.split("."))):
        return os.path.realpath(sys.executable)  # the same from each environment, so that one installation is enough
    return shutil.which(f"python{version}")


def main() -> int:
    """Provide all environments, at the same time; say which cannot be had."""
    with ThreadPoolExecutor(len(ENVIRONMENTS)) as pool:
        problems = dict(zip(ENVIRONMENTS, pool.map(provide, ENVIRONMENTS), strict=True))
    for environment, problem in problems.items():
        if problem:
            print(f"NOT PROVIDED: {environment.name}: {problem}", file=sys.stderr, flush=True)
    return 1 if any(problems.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
