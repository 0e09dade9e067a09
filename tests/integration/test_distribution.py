"""What is published works: the wheel of the source distribution, in environments with all extras and with none."""

from __future__ import annotations

import importlib.metadata
import json
import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.errors import install_hint
from riot_bus.vocabulary.message import Message
from tests.unit.report.conftest import rover

pytestmark = pytest.mark.integration

ROOT = Path(__file__).resolve().parents[2]
NAME = "riot-bus"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The source distribution, the wheel made from it, and the one made from the checkout."""
    folder = tmp_path_factory.mktemp("built")
    source = build(ROOT, "sdist", folder)
    with tarfile.open(source) as archive:
        archive.extractall(folder, filter="data")
    (unpacked,) = (each for each in folder.iterdir() if each.is_dir())
    return {
        "sdist": source,
        "wheel": build(unpacked, "wheel", folder),
        "direct": build(ROOT, "wheel", folder / "direct"),
    }


@pytest.fixture(scope="module")
def bare(built: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Programs of an environment that has riot-bus without extras."""
    return install(built["wheel"], tmp_path_factory.mktemp("bare"), extras=())


@pytest.fixture(scope="module")
def full(built: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Programs of an environment that has riot-bus[all]."""
    return install(built["wheel"], tmp_path_factory.mktemp("full"), extras=("all",))


@pytest.fixture
def work(tmp_path: Path) -> Path:
    """A folder with a log, the beginning of a file .tlog, and a finding."""
    with LogWriter(tmp_path / "a.mcap") as writer:
        writer.write(Message(10**18, "a", b'{"x": 1}'))
    (tmp_path / "a.tlog").write_bytes(bytes(8))
    (tmp_path / "finding").mkdir()
    for record in rover():
        record.save(tmp_path / "finding")
    return tmp_path


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


def test_the_wheel_of_the_source_distribution_is_that_of_the_checkout(built: dict[str, Path]) -> None:
    names = [sorted(zipfile.ZipFile(built[each]).namelist()) for each in ("wheel", "direct")]
    assert names[0] == names[1]
    shipped = {name.rpartition("/")[2] for name in names[0]}
    assert {"py.typed", "entry_points.txt", "LICENSE", "OccupancyGridUpdate.msg"} <= shipped
    assert not [name for name in names[0] if name.startswith(("tests/", "benchmarks/", "adapters/"))]


def test_the_first_step_of_the_demo_records_the_installed_rover(full: Path, tmp_path: Path) -> None:
    program = """
import sys
from pathlib import Path
from riot_bus.chain.base.systems import find_example
from riot_bus.chain.base.workspace import Workspace
system = find_example("rover")
assert system.is_relative_to(sys.prefix), system
with Workspace(system, Path(sys.argv[1])) as workspace:
    print(workspace.nominal_log())
"""
    recorded = run(full / "python", "-c", program, tmp_path).strip()
    told = json.loads(run(full / "riot", "info", recorded, "--format", "json"))
    counts = {each["topic"]: each["count"] for each in told["topics"]}
    assert counts["/map_updates"] > 10
    assert all(each["type"] for each in told["topics"]), told["topics"]


def test_dictionaries_adapters_and_examples_are_found(full: Path) -> None:
    program = """
from riot_bus.chain.base.systems import find_example
from riot_bus.inject.dictionary import load_dictionary
from riot_bus.trial.context import open_system
from riot_bus.types.registry import load_adapters
print(sorted(each.name for each in load_adapters()))
print(len(load_dictionary().values_for("float32")) > 3)
print(open_system(find_example("mavlink")).file.system.name)
"""
    assert run(full / "python", "-c", program).splitlines() == ["['mavlink', 'ros2']", "True", "drone"]


@pytest.mark.parametrize(
    ("words", "named", "extra"),
    [
        ("demo --out=out", "'rosbags'", "ros2"),
        ("record /odom", "ROS 2 topics", "ros2"),
        ("export a.mcap --field=a:x --out=a.parquet", "'pyarrow'", "export"),
        ("export a.mcap --out=a.tlog", "'.tlog'", "mavlink"),
        ("import a.tlog b.mcap", "'.tlog'", "mavlink"),
        ("bridge mavlink --link=/air=udpin:127.0.0.1:0 --endpoint=tcp/127.0.0.1:1", "'pymavlink'", "mavlink"),
        ("fleet index memory://logs", "'fsspec'", "fleet"),
        ("report finding", "'jinja2'", "report"),
    ],
    ids=str,
)
def test_without_its_extra_a_command_names_it(bare: Path, work: Path, words: str, named: str, extra: str) -> None:
    code, _, err = outcome(bare / "riot", *words.split(), cwd=work)
    assert code == 2, err
    assert named in err
    assert install_hint(extra) in err
