import json
import shlex
import tomllib

import pytest

from riot_bus.chain.steps.guard import plan_guard
from riot_bus.config.router_settings import RouterSettings
from riot_bus.interceptors.guard import RuleGuard
from riot_bus.interceptors.parsing import build_all, from_text
from riot_bus.vocabulary.errors import ConfigError
from tests.unit.chain.machine import bench, command, write_finding, write_minimal, write_rule


@pytest.fixture
def one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = bench(tmp_path)
    write_minimal(made)
    write_rule(made)
    return made


def test_it_is_tried_on_the_nominal_and_the_minimal_log(one):
    one.workspace.nominal_log()
    plan = plan_guard(one.folder, action="clamp")
    assert plan.rule == 'command:mode == "step" and command:speed < 1'
    assert [each.text() for each in plan.trials] == [
        "nominal log: the rule holds for 0 of 60 messages: all pass as they are",
        "minimal.mcap: the rule holds for 1 of 1 message: 1 clamped",
    ]


def test_without_a_nominal_log_nothing_is_said_of_one(one):
    plan = plan_guard(one.folder)
    assert [each.log for each in plan.trials] == ["minimal.mcap"]
    assert plan.trials[0].done == {"dropped": 1}


def test_messages_that_lack_a_field_are_told(one):
    cut = command("step", 2.0, 1).with_payload(b'{"mode": "step"}')
    write_finding(one, [command("step", -5.0), cut], {}, "minimal")
    (trial,) = plan_guard(one.folder).trials
    assert trial.text().endswith("of 2 messages: 1 dropped; 1 pass that lack a field of the rule")


def test_riot_toml_and_the_command_take_what_it_prints(one, monkeypatch, tmp_path):
    plan = plan_guard(one.folder, action="hold")
    tables = tomllib.loads(plan.toml)["router"]["interceptors"]
    assert tables == [{"use": "guard", "rule": "out/findings/hang-drive-1/rule.json", "action": "hold"}]
    monkeypatch.chdir("/")
    (built,) = build_all(
        (), tables=RouterSettings(interceptors=tuple(tables)).interceptors, file=tmp_path / "riot.toml"
    )
    assert isinstance(built, RuleGuard)
    assert built.rule == one.folder / "rule.json"
    words = shlex.split(plan.command)
    assert words[:3] == ["riot", "router", "--system"]
    assert from_text(words[words.index("--interceptor") + 1]) == built


def test_a_rule_that_no_guard_can_carry_out(one):
    record = json.loads((one.folder / "rule.json").read_text())
    record["rule"]["terms"] = [[{"feature": "nan", "args": ["command:speed"], "operator": "is", "value": None}]]
    (one.folder / "rule.json").write_text(json.dumps(record))
    with pytest.raises(ConfigError, match="clamp is not defined for command"):
        plan_guard(one.folder, action="clamp")


def test_without_a_rule_the_step_is_named(tmp_path):
    made = bench(tmp_path)
    write_minimal(made)
    with pytest.raises(ConfigError) as caught:
        plan_guard(made.folder)
    assert "riot rules" in str(caught.value)


def test_who_shares_the_unit_s_segment_is_told_since_nothing_is_intercepted_there(one):
    plan = plan_guard(one.folder)
    assert plan.bypassed == ("governor",)
    assert "nothing is intercepted between the unit and governor on its segment" in "\n".join(plan.lines())
    own = one.workspace.context.file.path.read_text().replace('"inside"]', '"inside", "own"]')
    place = own.index("[components.drive]")
    one.workspace.context.file.path.write_text(
        own[:place] + own[place:].replace('segment = "inside"', 'segment = "own"')
    )
    assert plan_guard(one.folder).bypassed == ()
