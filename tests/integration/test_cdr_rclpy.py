"""CDR and type hashes against real ROS 2, which makes and takes the payloads."""

import json
import random
import subprocess
from pathlib import Path

import pytest

from riot_bus.types.model import parse_path
from riot_bus_ros2.cdr import CdrType
from riot_bus_ros2.definitions import interface_of
from riot_bus_ros2.files import load_files
from riot_bus_ros2.live import SERVICE, described
from riot_bus_ros2.store import TypeStore
from tests.ros2_env import ros2_environment, ros2_interpreter
from tests.ros2_messages import encode, leaves, random_base, random_document, value_at, with_value

pytestmark = pytest.mark.integration

CODEC = Path(__file__).with_name("rclpy_codec.py")
EVERYTHING = 10_000


@pytest.fixture(scope="module")
def installed():
    """The folder of the installation, such as AMENT_PREFIX_PATH names."""
    return ros2_interpreter().parent.parent


@pytest.fixture(scope="module")
def official(installed):
    """Hash by name of every type of the installation."""
    found = {}
    for file in installed.glob("share/*/*/*.json"):
        for each in json.loads(file.read_text()).get("type_hashes", ()):
            found[each["type_name"]] = each["hash_string"]
    return found


@pytest.fixture(scope="module")
def store(installed):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AMENT_PREFIX_PATH", str(installed))
        yield TypeStore()


def through_ros(messages, folder):
    """Return the payloads as ROS 2 writes what it has read."""
    command = [str(ros2_interpreter()), str(CODEC)]
    lines = "".join(f"{name} {payload.hex()}\n" for name, payload in messages)
    done = subprocess.run(
        command,
        input=lines,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
        env=ros2_environment(0, folder),
    )
    assert done.returncode == 0, done.stderr[-2000:]
    found = [line.split() for line in done.stdout.splitlines()]
    assert [name for name, _ in found] == [name for name, _ in messages]
    return [bytes.fromhex(payload) for _, payload in found]


def fields(kind, payload):
    return [(leaf.path, leaf.value) for leaf in kind.leaves(payload, elements=EVERYTHING)]


def test_hashes_from_an_installation_are_the_official_ones(store, official):
    assert len(official) > 250
    assert {name: store.type_hash(name) for name in official} == official


def test_hashes_from_files_are_the_official_ones(installed, official):
    files = TypeStore()
    load_files([installed / "share"], files)
    assert {name: files.type_hash(name) for name in official} == official


@pytest.mark.nightly
def test_hashes_from_idl_are_the_official_ones(installed, official, tmp_path):
    for file in installed.glob("share/*/*/*.idl"):
        copy = tmp_path / file.parent.parent.name / file.parent.name / file.name
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(file.read_bytes())
    files = TypeStore()
    load_files([tmp_path], files)
    assert {name: files.type_hash(name) for name in official} == official


def test_hashes_without_an_installation_are_the_official_ones(official):
    bundled = TypeStore()
    known = {name: each for name, each in official.items() if bundled.definition(interface_of(name)) is not None}
    assert sum("/msg/" in name for name in known) >= 129
    assert sum("/srv/" in name for name in known) >= 80
    assert {name: bundled.type_hash(name) for name in known} == known


def test_official_descriptions_are_understood(installed, official):
    """As the replies of `get_type_description` hold them."""
    known = TypeStore()
    for file in sorted(installed.glob("share/*/*/*.json")):
        content = json.loads(file.read_text())
        if "type_description_msg" in content:
            description = content["type_description_msg"]
            name = description["type_description"]["type_name"]
            document = {"successful": True, "type_description": description}
            found = described(encode(f"{SERVICE}_Response", document), name, official[name], known)
            assert TypeStore(found).type_hash(name) == official[name]


def test_payloads_of_all_types_go_both_ways(store, official, tmp_path):
    """ROS 2 reads what others write; what ROS 2 writes, and what is changed in it, reads as it should."""
    kinds = {name: CdrType(name, store) for name in official if is_sent(name, store)}
    assert len(kinds) > 190
    rng = random.Random(5)
    wanted, sent = [], []
    for name in sorted(kinds) * 2:
        wanted.append((name, random_document(name, rng, store=store)))
        sent.append((name, encode(name, wanted[-1][1], store)))
    written = through_ros(sent, tmp_path)
    changed = []
    for (name, document), payload in zip(wanted, written, strict=True):
        kind = kinds[name]
        assert fields(kind, payload) == list(leaves(name, document, store=store))
        changed.append((name, change(kind, payload, document, rng)))
    for (name, document), payload in zip(wanted, through_ros(changed, tmp_path), strict=True):
        assert fields(kinds[name], payload) == list(leaves(name, document, store=store))


def is_sent(name, store):
    """Return whether there are messages of this type that can be taken apart."""
    kind = name.split("/")[1]
    is_whole = (kind != "msg" and name == interface_of(name)) or name.endswith(("_SendGoal", "_GetResult", "_Event"))
    parts = [field.content for each in store.closure(name) for field in store.fields(each)]
    return not is_whole and "wstring" not in parts


def change(kind, payload, document, rng):
    """Patch a scalar in place, and give a string another length; the same in the document."""
    scalars = [leaf for leaf in kind.leaves(payload) if not leaf.path.startswith("len(")]
    for leaf in rng.sample(scalars, min(2, len(scalars))):
        steps = parse_path(leaf.path).steps
        value = random_base(leaf.type, rng)
        if leaf.type == "string":
            value = value_at(document, steps)[:1] * 5
        with_value(document, steps, value)
        payload = kind.rebuild(payload, {leaf.path: value})
    return payload
