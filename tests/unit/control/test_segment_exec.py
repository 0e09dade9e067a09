from __future__ import annotations

import json
from pathlib import Path

import pytest

from riot_bus.control.segment_environment import export
from riot_bus.control.segment_exec import environment_in, session_files_folder
from riot_bus.vocabulary.errors import ConfigError

TWO = {"system": ["tcp/127.0.0.1:41234"], "unit": ["tcp/127.0.0.1:41235"]}
PASSWORD = "transport/auth/usrpwd/password"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    return tmp_path


def endpoint_in(segment: str, environ: dict[str, str], **options: object) -> str:
    """Return where a command in a segment connects, if both kinds of readers are told the same."""
    hints: list[str] = []
    found = environment_in(segment, environ, hint=hints.append, **options)  # type: ignore[arg-type]
    assert {key: found[key] for key in environ} == environ
    (endpoint,) = json.loads(Path(found["ZENOH_CONFIG"]).read_text())["connect"]["endpoints"]
    assert f'connect/endpoints=["{endpoint}"]' in found["ZENOH_CONFIG_OVERRIDE"]
    assert found["RIOT_ENDPOINT"] == endpoint
    return str(endpoint)


def test_where_a_segment_is_looked_for(folder: Path) -> None:
    assert endpoint_in("unit", {}) == "tcp/127.0.0.1:7448"
    (folder / "riot.toml").write_text('[router.segments.unit]\nlisten = ["tcp/0.0.0.0:7001"]\n')
    assert endpoint_in("unit", {}) == "tcp/127.0.0.1:7001"
    assert endpoint_in("unit", {}, host="robot") == "tcp/robot:7001"
    assert endpoint_in("unit", {"RIOT_SEGMENT": "unit=tcp/127.0.0.1:7002"}) == "tcp/127.0.0.1:7002"
    (folder / "other.toml").write_text('[router.segments.unit]\nlisten = ["tcp/127.0.0.1:7003"]\n')
    assert endpoint_in("unit", {"RIOT_SYSTEM": "other.toml"}) == "tcp/127.0.0.1:7003"
    running = {"RIOT_SYSTEM": "other.toml", **export(TWO)}
    assert endpoint_in("unit", running) == "tcp/127.0.0.1:41235"
    assert endpoint_in("unit", running, system=Path("other.toml")) == "tcp/127.0.0.1:7003"
    assert endpoint_in("unit=tcp/127.0.0.1:7004", running) == "tcp/127.0.0.1:7004"


def test_whoever_opened_the_router_owns_the_file(folder: Path) -> None:
    found = environment_in("unit", export(TWO, files=folder), hint=lambda _: None)
    assert found["ZENOH_CONFIG"] == str(folder / "zenoh-unit.json5")
    assert not (folder / "run").exists()


def test_secrets_are_in_a_file_of_this_user(folder: Path) -> None:
    (folder / "password").touch(0o600)
    (folder / "password").write_text("s3kR1t\n")
    found = environment_in("unit", export(TWO, files=folder), cfg=[f"{PASSWORD}=@password"], hint=lambda _: None)
    file = Path(found["ZENOH_CONFIG"])
    assert json.loads(file.read_text())["transport"]["auth"]["usrpwd"]["password"] == "s3kR1t"
    assert file.is_relative_to(folder / "run")
    assert [path.stat().st_mode & 0o077 for path in (file, file.parent, file.parents[1])] == [0, 0, 0]


def test_files_are_as_many_as_configurations(folder: Path) -> None:
    for _ in range(3):
        endpoint_in("unit", {})
        endpoint_in("system", {})
    assert len(list((folder / "run").rglob("*.json5"))) == 2


def test_what_is_missing_is_said(folder: Path) -> None:
    (folder / "users").touch(0o600)
    config = '[router.segments.unit]\nlisten = ["tcp/127.0.0.1:1"]\n[router.segments.unit.config]\n'
    (folder / "riot.toml").write_text(config + '"transport/auth/usrpwd/dictionary_file" = "users"\n')
    hints: list[str] = []
    environment_in("unit", {}, hint=hints.append)
    assert [hint.partition(":")[0] for hint in hints] == [
        "the segment asks for a user",
        "the segment asks for a password",
    ]


def test_unknown_segments() -> None:
    with pytest.raises(ConfigError, match=r"no segment 'unti'\n.*'unit'"):
        environment_in("unti", {}, hint=lambda _: None)
    with pytest.raises(ConfigError, match=r"no segment 'unti'\n.*'unit'"):
        environment_in("unti", export(TWO), cfg=["transport/link/tx/lease=5000"], hint=lambda _: None)


def test_nobody_else_can_prepare_the_folder(folder: Path) -> None:
    (folder / "run" / "riot-bus").mkdir(parents=True)
    (folder / "run" / "riot-bus").chmod(0o777)
    with pytest.raises(ConfigError, match="others may write there"):
        session_files_folder("text")
    (folder / "run" / "riot-bus").rmdir()
    (folder / "run" / "riot-bus").symlink_to(folder)
    with pytest.raises(ConfigError, match="others may write there"):
        session_files_folder("text")
