"""`riot info`, `riot types` and `riot export`."""

import json

import pytest
from typer.testing import CliRunner

from riot_bus.cli.main import make_app
from riot_bus.log.account import LOST, Account
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.vocabulary.errors import ConfigError, DataLossError, RiotError
from riot_bus.vocabulary.message import Message
from tests.log_mutants import COUNT, MESSAGES, channel, chunk, foreign, note, ours, whole

APP = make_app()


def riot(*words, error=None):
    """Run a command; return what it prints to stdout and stderr."""
    done = CliRunner().invoke(APP, [str(word) for word in words], catch_exceptions=True)
    if error is None:
        assert done.exception is None, done.exception
    else:
        assert isinstance(done.exception, error), done.exception
        assert isinstance(done.exception, RiotError)
        return done.stdout, str(done.exception)
    return done.stdout, done.stderr


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(foreign("zstd"))
    return path


def test_info(log):
    out, _ = riot("info", log)
    lines = out.splitlines()
    assert lines[0].split() == ["topic", "type", "messages", "Hz"]
    assert lines[1].split()[:3] == ["/string", "std_msgs/msg/String", "30"]
    assert f"{COUNT} messages, from 2001-09-09 01:46:40 UTC" in out
    assert "profile ros2, by somebody" in out
    assert "summary" not in out


def test_a_folder_with_one_log_will_do(log, tmp_path):
    out = tmp_path / "table.csv"
    commands = [["info"], ["types"], ["export", "--field", "/string:data", "-o", out]]
    for command, *more in commands:
        assert riot(command, tmp_path, *more)[0].replace(str(tmp_path), "") == riot(
            command, log, *more, *(["--force"] if more else [])
        )[0].replace(str(tmp_path), "")
    (tmp_path / "b.mcap").write_bytes(log.read_bytes())
    for command, *more in commands:
        _, error = riot(command, tmp_path, *more, error=ConfigError)
        assert "this folder holds 2 logs" in error
        assert f"name one, such as {log}, or join them first" in error


@pytest.mark.parametrize("words", [["info", "--fields"], ["types"]])
def test_a_topic_that_the_log_has_not_is_an_error(log, words):
    command, *more = words
    _, error = riot(command, log, *more, "--topics", "/strin", error=ConfigError)
    assert "no topic '/strin' in the log" in error
    assert "did you mean '/string'" in error
    assert "/string" in riot(command, log, *more, "--topics", "/string")[0]


def test_a_type_that_is_not_spelt_right_is_found_by_its_short_name():
    _, error = riot("types", "Odometri", error=ConfigError)
    assert "did you mean 'nav_msgs/msg/Odometry'" in error


def test_a_damaged_log_is_exported_as_far_as_wanted(tmp_path):
    path, out = tmp_path / "a.mcap", tmp_path / "a.csv"
    with LogWriter(path, LogSettings(compression="none")) as writer:
        for number in range(30):
            writer.write(Message(number + 1, "k", b'{"x": %2d}' % number, encoding="application/json"))
    data = bytearray(path.read_bytes())
    data[data.index(b'{"x": 17}') - 22] ^= 0xFF
    path.write_bytes(data)
    _, error = riot("info", path, error=DataLossError)
    assert "29 messages of them could be salvaged" in error
    assert "hint: riot edit, play and export" in error
    _, error = riot("export", path, "--field", "k:x", "-o", out, error=DataLossError)
    assert "--salvage" in error
    assert len(out.read_text().splitlines()) == 1
    _, error = riot("export", path, "--field", "k:x", "-o", out, "--force", "--salvage", error=DataLossError)
    assert "29 messages of them salvaged, unverified" in error
    assert "hint" not in error
    assert len(out.read_text().splitlines()) == 30


def test_info_from_the_summary(log):
    out, _ = riot("info", log, "--no-scan")
    assert "from the summary alone; --scan" in out
    document = json.loads(riot("info", log, "--no-scan", "--format", "json")[0])
    assert (document["scanned"], document["count"]) == (False, COUNT)


def test_info_says_what_the_run_was_and_what_was_lost(tmp_path):
    path = tmp_path / "a.mcap"
    with LogWriter(path, metadata={"seed": "7"}) as writer:
        writer.write(Message(1, "k", b"{}"))
        writer.note(LOST, Account({"k": 1}, {"disk": {"k": 3}}).record())
    out, problem = riot("info", path, error=DataLossError)
    assert "seed: 7" in out
    assert "lost when recorded (disk): 3 of k" in out
    assert "3 messages were lost when it was recorded" in problem
    document = json.loads(riot("info", path, "--format", "json", error=DataLossError)[0])
    assert document["account"]["lost"] == {"disk": {"k": 3}}
    assert document["metadata"] == {"seed": "7"}


def test_info_of_a_damaged_log(log):
    log.write_bytes(foreign("zstd")[:-300])
    out, problem = riot("info", log, error=DataLossError)
    assert "/twist" in out
    assert "not closed" in problem
    assert DataLossError.exit_code == 3


def test_info_counts_gaps_in_the_numbers_of_publishers(tmp_path):
    from riot_bus_ros2.attachment import Attachment, build_attachment

    path = tmp_path / "a.mcap"
    with LogWriter(path) as writer:
        for publisher, numbers in ((b"a" * 16, [1, 2, 5, 4, 6, 6, 9]), (b"b" * 16, [7, 8])):
            for number in numbers:
                attached = build_attachment(Attachment(number, 0, publisher))
                writer.write(Message(number, "k", b"{}", attachment=attached))
    out, _ = riot("info", path)
    assert out.splitlines()[0].split() == ["topic", "type", "messages", "Hz", "missing"]
    assert json.loads(riot("info", path, "--format", "json")[0])["topics"][0]["missing"] == 3


def test_fields(log):
    out, _ = riot("info", log, "--topics", "/twist")
    assert "/twist (geometry_msgs/msg/Vector3): 30 messages" in out
    assert ["x", "float64", "30", "0", "58"] in [line.split() for line in out.splitlines()]
    assert "std_msgs/msg/String)" not in out
    document = json.loads(riot("info", log, "--fields", "--format", "json")[0])
    assert [topic["topic"] for topic in document["fields"]] == ["/string", "/twist"]
    assert document["fields"][1]["fields"][0]["high"] == 58.0


def test_infinite_ranges_are_json(tmp_path):
    path = tmp_path / "a.mcap"
    with LogWriter(path) as writer:
        writer.write(Message(1, "k", b'{"x": Infinity}', encoding="application/json"))
    out, _ = riot("info", path, "--fields", "--format", "json")
    assert json.loads(out, parse_constant=pytest.fail)["fields"][0]["fields"][0]["high"] == "inf"


def test_names_in_a_log_do_not_command_the_terminal(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(
        whole(note("riot_bus.run", {"\x1b[2J": "\x07"}), chunk(channel(1, "/a\x1b[31m[red]\n", 0) + MESSAGES))
    )
    for command in (["info", path, "--fields"], ["types", path]):
        out, _ = riot(*command)
        assert "\x1b" not in out
        assert "\\x1b[31m[red]" in out


def test_types_of_a_log(log):
    out, _ = riot("types", log)
    assert out.splitlines() == [
        "/string: std_msgs/msg/String (cdr)",
        "  data  string",
        "/twist: geometry_msgs/msg/Vector3 (cdr)",
        "  x  float64",
        "  y  float64",
        "  z  float64",
    ]
    document = json.loads(riot("types", log, "--topics", "/twist", "--format", "json")[0])
    assert [each["topic"] for each in document] == ["/twist"]
    assert document[0]["fields"][0] == {
        "path": "x", "type": "float64", "length": 0, "low": None, "high": None, "unit": "", "names": [],
    }  # fmt: skip


def test_known_types():
    names = riot("types")[0].splitlines()
    assert {"json", "msgpack", "nav_msgs/msg/Odometry"} <= set(names)
    out, _ = riot("types", "Odometry")
    assert out == riot("types", "nav_msgs/msg/Odometry")[0]
    assert "  pose.covariance[*]       float64[36]" in out
    assert riot("types", "json")[0] == "json (json)\n"
    assert json.loads(riot("types", "--format", "json")[0]) == names
    assert "Odometry" in riot("types", "nav_msgs/msg/Odometri", error=ConfigError)[1]


def test_types_of_our_own_definitions(tmp_path):
    file = tmp_path / "own_msgs" / "msg" / "Thing.msg"
    file.parent.mkdir(parents=True)
    file.write_text("float32[2] pair\n")
    out, _ = riot("types", "own_msgs/msg/Thing", "--msg", file)
    assert out.splitlines() == ["own_msgs/msg/Thing (cdr)", "  pair[*]  float32[2]"]


def test_export(log, tmp_path):
    out = tmp_path / "a.csv"
    printed, warned = riot("export", log, "--field", "/twist:x", "--start", "0.00000001", "--out", out)
    assert printed == f"{out}: 25 rows\n"
    assert not warned
    assert out.read_text().splitlines()[1].endswith(",/twist,10.0")
    riot("export", log, "--field", "/twist:x", "-o", out, error=ConfigError)
    document = json.loads(riot("export", log, "--field", "/twist:x", "-o", out, "--force", "--format", "json")[0])
    assert document == {"file": str(out), "rows": COUNT // 2, "values": {"/twist:x": COUNT // 2}}


def test_export_says_that_a_field_is_nowhere(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(ours("zstd"))
    _, warned = riot("export", path, "--field", "rover/a:speed", "-o", tmp_path / "a.csv")
    assert "no message has a value of rover/a:speed" in warned


def test_export_of_a_damaged_log(log, tmp_path):
    log.write_bytes(foreign("zstd")[:-300])
    _, problem = riot("export", log, "--field", "/twist:x", "-o", tmp_path / "a.csv", error=DataLossError)
    assert "not closed" in problem
    assert (tmp_path / "a.csv").exists()


def test_types_by_hand(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(whole(chunk(channel(1, "/twist", 0, "") + MESSAGES)))
    declared = ["--type", "/twist=geometry_msgs/msg/Vector3"]
    assert "x  float64" in riot("types", path, *declared)[0]
    assert "59" in riot("info", path, "--fields", *declared)[0]
    riot("export", path, "--field", "/twist:x", "-o", tmp_path / "a.csv", *declared)
    problem = riot("types", path, "--type", "odd", error=ConfigError)[1]
    assert problem.startswith("--type: 'odd' is not a topic and its type")


@pytest.mark.parametrize("data", [b"", b"text", None])
def test_what_is_no_log(tmp_path, data):
    path = tmp_path / "a.mcap"
    if data is not None:
        path.write_bytes(data)
    for command in (["info", path], ["info", path, "--no-scan"], ["types", path]):
        riot(*command, error=ConfigError)
    riot("export", path, "--field", "/a:x", "-o", tmp_path / "a.csv", error=ConfigError)
