"""`riot ros-test` as a command, on a suite of pytest."""

from __future__ import annotations

import shutil
import signal
import sys
from pathlib import Path

import pytest

from riot_bus.log.reader import LogReader
from tests.integration.existing_suite import ros_test, write_suite
from tests.integration.router_process import riot

pytestmark = pytest.mark.integration

NAN = "set field=x value=nan select=pose"


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    write_suite(tmp_path)
    return tmp_path


def test_with_nothing_intercepted_the_results_are_as_without_it(suite: Path) -> None:
    code, out, said = ros_test(suite, "--unit-nodes=listener")
    assert (code, said) == (0, ["nothing was to be intercepted", "in segment unit: listener"])
    assert "1 passed" in out


def test_one_field_that_is_no_number_is_seen_and_recorded(suite: Path) -> None:
    code, out, said = ros_test(suite, "--unit-nodes=listener", "--interceptor", NAN, "--record=run.mcap")
    assert (code, said[1:]) == (1, ["in segment unit: listener"])
    assert "[nan, nan, nan]" in out
    passed, _, recording = said[0].partition("; recording ")
    assert "messages of 1 topic intercepted: " in passed
    with LogReader(suite / "run.mcap") as log:
        found = list(log.messages())
    assert recording == f"{suite / 'run.mcap'} ({len(found)} messages)"
    assert {message.payload for message in found if message.key == "pose"} == {b'{"x": NaN}'}


def test_sessions_that_would_look_for_others_by_scouting_use_the_router(tmp_path: Path) -> None:
    write_suite(tmp_path, config="zenoh.Config()")
    code, out, said = ros_test(tmp_path, "--unit-nodes=listener", "--interceptor", NAN)
    assert (code, said[1:]) == (1, ["in segment unit: listener"])
    assert "[nan, nan, nan]" in out


@pytest.mark.parametrize("recorded", [[], ["--record=logs"]])
def test_who_is_in_one_segment_gets_nothing_of_riot_which_is_said(recorded: list[str], suite: Path) -> None:
    code, _, said = ros_test(suite, "--interceptor", NAN, *recorded)
    assert code == 0
    assert said[1].startswith("NOTHING WAS INTERCEPTED: ")
    assert said[2:] == [
        "  hint: all processes are in the segment system: name those for the segment unit with --unit-nodes"
    ]


def test_names_that_nobody_has(suite: Path) -> None:
    code, _, said = ros_test(suite, "--unit-nodes=listner", "--intercept=pose")
    assert (code, said[-1]) == (0, "  hint: no process is called 'listner'; started were: listener, talker")


def test_a_command_that_uses_no_router(tmp_path: Path) -> None:
    code, _, said = ros_test(tmp_path, command=["true"])
    assert (code, said[1]) == (0, "NOTHING USED THIS ROUTER: no component has connected to it")


def test_an_injection_that_never_happens_is_said(suite: Path) -> None:
    (suite / "plan.toml").write_text('[[inject]]\ntopic = "pose"\nfield = "y"\nvalue = 1.0\n')
    code, _, said = ros_test(suite, "--unit-nodes=listener", "--inject=plan.toml")
    assert code == 0
    assert said[1].startswith("not injected: pose: ")
    assert said[-1].startswith("NOTHING WAS INJECTED")


def test_an_interceptor_that_fails_on_each_message_is_said(suite: Path) -> None:
    code, _, said = ros_test(suite, "--unit-nodes=listener", "--interceptor", "set field=z value=1 select=pose")
    assert code == 0
    assert said[1].startswith("interceptor set failed on ")
    assert "no field 'z'" in said[1]
    assert said[-1].startswith("NOTHING WAS CHANGED")


def test_recordings_go_by_folder_and_are_never_overwritten(suite: Path) -> None:
    for _ in range(2):
        ros_test(suite, "--record=logs", command=["true"])
    assert sorted(path.name for path in (suite / "logs").iterdir()) == [f"{suite.name}-2.mcap", f"{suite.name}.mcap"]


@pytest.mark.parametrize(("command", "status"), [("exit 7", 7), ("kill -TERM $$", -signal.SIGTERM)])
def test_the_exit_status_is_the_commands(command: str, status: int, tmp_path: Path) -> None:
    assert ros_test(tmp_path, command=["sh", "-c", command])[0] == status


def test_what_cannot_be_started(tmp_path: Path) -> None:
    code, _, said = ros_test(tmp_path, command=["./no-such-program"])
    assert (code, said) == (
        4,
        ["'./no-such-program' does not start: [Errno 2] No such file or directory: './no-such-program'"],
    )


ENVIRONMENT_LINES = ["sh", "-c", "env; echo done"]


def test_tests_are_not_isolated_a_second_time(tmp_path: Path) -> None:
    _, out, _ = ros_test(tmp_path, command=ENVIRONMENT_LINES)
    found = dict(line.partition("=")[::2] for line in out.splitlines())
    assert found["RMW_TEST_FIXTURE_DISABLE_ISOLATION"] == found["DISABLE_ROS_ISOLATION"] == "1"
    assert found["RMW_IMPLEMENTATION"] == "rmw_zenoh_cpp"
    assert found["RIOT_ENDPOINT"] in found["ZENOH_CONFIG_OVERRIDE"]
    assert "ZENOH_RUNTIME" not in found
    assert {word.partition("=")[0] for word in found["RIOT_ENDPOINTS"].split()} == {"system", "unit"}


def test_another_middleware_of_the_user_is_not_replaced_silently(tmp_path: Path) -> None:
    _, _, err = riot("ros-test", "--", "true", cwd=tmp_path, environment={"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"})
    assert "warning: RMW_IMPLEMENTATION=rmw_fastrtps_cpp is not rmw_zenoh_cpp" in err


def test_riot_exec_knows_the_segments(suite: Path) -> None:
    command = ["sh", "-c", f"'{sys.executable}' -m riot_bus exec --segment unit -- env"]
    _, out, _ = ros_test(suite, command=command)
    found = dict(line.partition("=")[::2] for line in out.splitlines())
    assert f"unit={found['RIOT_ENDPOINT']}" in found["RIOT_ENDPOINTS"].split()
    assert found["ZENOH_CONFIG"].endswith("/zenoh-unit.json5")


def test_the_router_is_its_own_whatever_riot_toml_says(suite: Path) -> None:
    (suite / "riot.toml").write_text(
        '[router]\nintercept = ["pose"]\ncontrol = ["robot"]\n'
        '[router.segments.robot]\nlisten = ["tcp/0.0.0.0:7447"]\nconnect = ["tcp/192.0.2.1:7447"]\n'
    )
    code, _, said = ros_test(suite, "--unit-nodes=listener")
    assert code == 0
    assert " of 1 topic intercepted: 0 changed" in said[0]


THIRD_PARTY = Path(__file__).with_name("third_party")


def test_the_environment_of_rmw_zenoh_is_read_by_others(python: Path, tmp_path: Path) -> None:
    for node in ("planner", "driver"):
        shutil.copy(THIRD_PARTY / "ros_node.py", tmp_path / f"{node}.py")
    command = [str(python), str(THIRD_PARTY / "suite.py")]
    variables = {"GIT_ALLOW_PROTOCOL": "file", "ZENOH_ROS2_SDK_CACHE": str(tmp_path)}
    code, out, said = ros_test(tmp_path, "--unit-nodes=driver", "--intercept=/cmd_vel", command=command, **variables)
    assert (code, out, said[1]) == (0, "[1.5, 1.5]\n", "in segment unit: driver")
    options = ("--unit-nodes=driver", "--interceptor=set field=linear.x value=nan select=/cmd_vel")
    code, out, said = ros_test(tmp_path, *options, command=command, **variables)
    assert (code, out, said[1]) == (3, "[nan, nan]\n", "in segment unit: driver")
