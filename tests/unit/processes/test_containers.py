from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from riot_bus.processes.containers import container_commands, engine_of, first_process, image_id
from riot_bus.system.system_file import Container
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError

ENV = {"GAIN": "2", "NAME": "a b"}


def engine(folder: Path, text: str, name: str = "podman") -> str:
    """Return a program that answers as an engine would."""
    path = folder / name
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


def test_an_image_is_run_in_the_network_of_this_machine(tmp_path: Path) -> None:
    container = Container(image="registry/planner:2", engine="podman", options=("--memory=1g",))
    run, remove = container_commands(
        container, "riot-1-planner", command=["plan", "-v"], env=ENV, folder=tmp_path, cwd=tmp_path
    )
    options = ["--rm", "--name", "riot-1-planner", "--env=GAIN", "--env=NAME", f"--volume={tmp_path}:{tmp_path}"]
    assert run == [
        *("podman", "run", "--network=host", "--init"),
        *options,
        *("--memory=1g", "registry/planner:2", "plan", "-v"),
    ]
    assert remove[-2:] == ["podman", "riot-1-planner"]


AS_RUN = """services:
  "planner":
    network_mode: host
    init: true
    extra_hosts: ["map:127.0.0.1", "planner:127.0.0.1"]
    environment: ["GAIN", "NAME"]
"""


@pytest.mark.parametrize("words", [["docker", "compose"], ["podman-compose"]])
@pytest.mark.parametrize(
    ("networks", "reset"),
    [
        ("", ""),
        ("    networks:\n      default: null\n", ""),
        ("    networks:\n    - robot\n", "    networks: !reset null\n"),
        ("    networks:\n      default: null\n      robot: null\n", "    networks: !reset null\n"),
    ],
)
def test_a_service_is_run_alone_and_in_the_network_of_this_machine(
    tmp_path: Path, words: list[str], networks: str, reset: str
) -> None:
    there = tmp_path / "there"
    there.mkdir()
    shown = f"services:\n  map:\n    image: x\n    networks:\n    - robot\n  planner:\n{networks}    image: y\n"
    (there / "stack.yaml").write_text(f"{shown}networks:\n  robot: {{}}\n")
    answer = f'case "$*" in *"-f {there}/stack.yaml config") cat {there}/stack.yaml;; esac'
    compose = [engine(tmp_path, answer, words[0]), *words[1:]]
    program = compose[0].removesuffix("-compose")
    container = Container(image="planner", compose="stack.yaml", service="planner", engine=program)
    run, _ = container_commands(container, "riot-1-planner", command=[], env=ENV, folder=tmp_path, cwd=there)
    changed = tmp_path / "riot-1-planner.compose.yaml"
    assert run[: len(compose)] == compose
    rest = run[len(compose) :]
    assert rest[:7] == ["-f", "stack.yaml", "-f", str(changed), "run", "--no-deps", "-T"]
    assert rest[-1] == "planner"
    assert not [word for word in rest if word.startswith("--env") or "a b" in word]
    assert changed.read_text() == f"{AS_RUN}{reset}x-podman: {{ in_pod: false }}\n"


def test_a_compose_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    container = Container(image="planner", compose="stack.yaml", service="planner", engine=engine(tmp_path, ""))
    with pytest.raises(ConfigError, match=r"container.compose: cannot read '.*stack.yaml': .*No such file"):
        container_commands(container, "one", command=[], env={}, folder=tmp_path, cwd=tmp_path)


def test_removing_is_no_error_where_there_is_nothing(tmp_path: Path) -> None:
    program = engine(tmp_path, 'echo "$@" >> asked; exit 1')
    one = Container(image="x", engine=program)
    _, remove = container_commands(one, "one", command=[], env={}, folder=tmp_path, cwd=tmp_path)
    subprocess.run(remove, cwd=tmp_path, check=True)
    assert (tmp_path / "asked").read_text() == "kill one\nrm -f one\n"


def test_podman_comes_before_docker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ConfigError, match="no podman and no docker"):
        engine_of(Container(image="x"))
    engine(tmp_path, "", "docker")
    assert engine_of(Container(image="x")) == "docker"
    engine(tmp_path, "")
    assert engine_of(Container(image="x")) == "podman"
    assert engine_of(Container(image="x", engine="nerdctl")) == "nerdctl"


def test_the_process_of_a_container(tmp_path: Path) -> None:
    assert first_process(engine(tmp_path, "echo 77"), "one") == 77
    assert first_process(engine(tmp_path, "echo 0"), "one") == 0
    assert first_process(engine(tmp_path, "echo no such container >&2; exit 125"), "one") == 0


def test_the_hash_of_an_image(tmp_path: Path) -> None:
    container = Container(image="planner", engine=engine(tmp_path, "echo sha256:00ff"))
    assert image_id(container) == "sha256:00ff"
    missing = Container(image="planner", engine=engine(tmp_path, "echo Error: no such image >&2; exit 125"))
    with pytest.raises(EnvironmentFaultError, match="no image 'planner': Error: no such image"):
        image_id(missing)
    gone = Container(image="planner", engine=os.path.join(tmp_path, "nothing"))
    with pytest.raises(EnvironmentFaultError, match="cannot be asked about containers"):
        image_id(gone)
