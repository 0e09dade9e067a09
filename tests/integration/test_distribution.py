"""What is published works: the wheel of the source distribution, in environments with all extras and with none."""

from __future__ import annotations

import json
import tarfile
import zipfile
from pathlib import Path

import pytest

from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.errors import install_hint
from riot_bus.vocabulary.message import Message
from tests.distribution import ROOT, build, install, outcome, run
from tests.unit.report.conftest import rover

pytestmark = pytest.mark.integration


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
