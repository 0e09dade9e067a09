from __future__ import annotations

import json

import numpy as np
import pytest

from riot_bus.findings.backtrack import BacktrackRecord
from riot_bus.findings.records import CertificateRecord, FieldRecord, FieldsRecord, FindingRecord
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_fleet.evidence.backchain import backchain
from tests.unit.chain.offline import SYSTEM, known_graph, write_log


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder, rng = tmp_path_factory.mktemp("logs"), np.random.default_rng(1)
    return [write_log(folder / f"{at}.mcap", rng, graph=known_graph()) for at in range(2)]


@pytest.fixture
def system(tmp_path):
    (tmp_path / "riot.toml").write_text(SYSTEM)
    return tmp_path / "riot.toml"


def named(record):
    return {one.source for one in record.ranking if one.found}


def test_the_recorded_graph_is_followed(logs):
    record = backchain(logs, "unit:v", externals=["goal", "odom", "battery"])
    assert named(record) == {"goal:v", "odom:v"}
    assert record.told == ("recorded graph of 2 of 2 logs",)
    assert {(one.source, one.target) for one in record.steps} == {("map", "unit"), ("odom", "unit"), ("goal", "map")}
    assert record.unreachable == ("battery",)
    assert (record.messages, record.looked_at, len(record.logs)) == (1800, 1800, 2)
    assert BacktrackRecord.model_validate(json.loads(record.model_dump_json())) == record


def test_riot_toml_is_followed_first(logs, system):
    record = backchain(logs, "unit:v", system=system)
    assert named(record) == {"goal:v", "odom:v"}
    assert record.told[0] == str(system)
    assert record.missing == ("lost",)
    assert record.loops == (("odom", "unit"),)
    assert record.externals == dict.fromkeys(("battery", "goal", "odom"), "riot.toml")


def test_the_fields_of_a_finding_are_taken_and_the_result_is_kept_there(logs, system, tmp_path):
    folder = tmp_path / "finding"
    folder.mkdir()
    names = {"id": "x", "system": "small", "unit": "planner", "component": "planner", "monitor": "m", "signature": "s"}
    FindingRecord(system_file=str(system), **names).save(folder)
    certificate = CertificateRecord(
        failing=1.0, passing=0.0, failing_log="", passing_log="", confirmed_failing=1, confirmed_passing=1, repeats=1
    )
    field = FieldRecord(name="unit[0]:v", kind="exceptional", type="float64", failing=1.0, certificate=certificate)
    order = field.model_copy(update={"name": "odom before goal", "type": "bool"})
    FieldsRecord(fields=(order,), considered=(order.name,), bound=0.05, straight=60).save(folder)
    with pytest.raises(ConfigError, match="no field is relevant to this finding"):
        backchain(logs, str(folder))
    FieldsRecord(fields=(field, order), considered=("unit[0]:v", order.name), bound=0.05, straight=60).save(folder)
    record = backchain(logs, str(folder))
    assert record.targets == {"unit:v": ""}
    assert BacktrackRecord.load(folder) == record


@pytest.mark.parametrize(
    ("target", "options", "text"),
    [
        ("unit", {}, "neither a field nor the folder of a finding"),
        ("units:v", {}, "did you mean 'unit'"),
        ("unit:vv", {}, "did you mean 'unit:v'"),
        ("unit:v", {"externals": ["gaol"]}, "did you mean 'goal'"),
    ],
)
def test_errors_say_what_to_do(logs, target, options, text):
    with pytest.raises(ConfigError, match=text):
        backchain(logs[:1], target, **options)
