"""Components in containers: commands of podman, docker and compose that start, find and remove a container."""

from __future__ import annotations

import functools
import json
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.system.system_file import Container

_ENGINES = ("podman", "docker")
"""Engines in order of preference: podman comes first, as its containers are descendants of riot's own processes."""
_REMOVE = '"$0" kill "$1"; "$0" rm -f "$1"; exit 0'
"""Kill before removal, since some engines give a removed container ten seconds to end; it may be gone already."""


def engine_of(container: Container) -> str:
    """Return the program that runs containers: the one that riot.toml names, else the first that is installed.

    Raises:
        ConfigError: No such program is installed.
    """
    if container.engine is not None:
        return container.engine
    found = next((each for each in _ENGINES if shutil.which(each)), None)
    if found is None:
        raise ConfigError("no podman and no docker to run a container", hint="install one, or name it: engine = PATH")
    return found


def container_commands(
    container: Container, name: str, *, command: Sequence[str], env: Mapping[str, str], folder: Path, cwd: Path
) -> tuple[list[str], list[str]]:
    """Return the commands that run and remove a container with this machine's network.

    The first one runs it to its end, with its output and status; its process 1 forwards signals. It has to be executed
    with the variables, whose values are on no command line, as every user of this machine sees those.

    Args:
        container: Settings of the container in riot.toml, with placeholders filled in.
        name: Name that the container gets, unique on this machine.
        command: Command that replaces the image's own one; empty for the latter.
        env: Variables that the container gets in addition to those of its image.
        folder: Folder of the trial, visible in the container under the same path.
        cwd: Folder that paths start from.

    Raises:
        ConfigError: There is no program that runs containers, or the compose file cannot be read.
        EnvironmentFaultError: The program that reads compose files does not answer.
    """
    engine = engine_of(container)
    words = ["--rm", "--name", name]
    own = [f"--volume={folder}:{folder}", *container.options]
    if container.service is None:
        words += [f"--env={key}" for key in env]
        run = [engine, "run", "--network=host", "--init", *words, *own, container.image, *command]
    else:
        program = (engine, "compose") if os.path.basename(engine) == "docker" else (f"{engine}-compose",)
        compose = container.compose or ""
        changed = _as_run(container.service, program, cwd / compose, list(env))
        (override := folder / f"{name}.compose.yaml").write_text(changed, encoding="utf-8")
        files = [compose, str(override)]
        run = [*program, *(word for file in files for word in ("-f", file)), "run", "--no-deps", "-T"]
        run += [*words, *own, container.service, *command]
    return run, ["sh", "-c", _REMOVE, engine, name]


def _as_run(service: str, program: tuple[str, ...], compose: Path, variables: list[str]) -> str:
    """Return a compose file with the settings of a service that riot runs, to be read after the service's own file.

    Variables are named there, since not each program takes `--env=NAME` without a value.

    The service has this machine's network, where all other services of the file have the address of this machine.
    """
    try:
        changed = compose.stat().st_mtime_ns
    except OSError as error:
        hint = "paths start from the folder of riot.toml, or from `cwd`"
        raise ConfigError(f"cannot read {str(compose)!r}: {error}", where="container.compose", hint=hint) from None
    services = _services(program, str(compose), changed)
    hosts = json.dumps([f"{each}:127.0.0.1" for each in services])
    lines = ["services:", f"  {json.dumps(service)}:", "    network_mode: host", "    init: true"]
    lines += [f"    extra_hosts: {hosts}", f"    environment: {json.dumps(variables)}"]
    lines += ["    networks: !reset null"] if services.get(service) else []
    lines += ["x-podman: { in_pod: false }"]  # else podman-compose leaves an empty pod, and prints its number
    return "\n".join(lines) + "\n"


@functools.lru_cache(maxsize=8)
def _services(program: tuple[str, ...], compose: str, changed: int) -> Mapping[str, bool]:
    """Return all services of a compose file, each with whether it has networks, as long as it has not `changed`.

    Those without get the network `default`, which docker shows, too; only newer programs can take networks away.
    """
    shown = _ask(*program, "-f", compose, "config").stdout  # with two spaces for each level, however it was written
    section = re.search(r"^services:\n((?: .*\n)*)", shown, re.MULTILINE)
    blocks = re.findall(r"^  ([A-Za-z0-9._-]+):\n((?:    .*\n)*)", section[1] if section else "", re.MULTILINE)
    own = re.compile(r"^    networks:\n(?!      default: null\n(?!      ))", re.MULTILINE)
    return {name: own.search(block) is not None for name, block in blocks}


def first_process(engine: str, name: str) -> int:
    """Return the id on this machine of a container's process 1; 0 as long as there is none.

    Raises:
        EnvironmentFaultError: The engine does not answer.
    """
    done = _ask(engine, "inspect", "--format", "{{.State.Pid}}", name)
    return int(done.stdout) if done.returncode == 0 and done.stdout.strip().isdigit() else 0


def image_id(container: Container) -> str:
    """Return the hash of a container's image, which identifies the code that runs in the container.

    Raises:
        ConfigError: There is no program that runs containers.
        EnvironmentFaultError: The program does not answer, or has no such image.
    """
    engine = engine_of(container)
    done = _ask(engine, "image", "inspect", "--format", "{{.Id}}", container.image)
    if done.returncode:
        told = (done.stderr.strip().splitlines() or [f"status {done.returncode}"])[-1]
        hint = f"get or build it first: {engine} pull {container.image}"
        raise EnvironmentFaultError(f"{engine} has no image {container.image!r}: {told}", hint=hint)
    return done.stdout.strip()


def _ask(engine: str, *words: str) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run([engine, *words], capture_output=True, text=True, timeout=30.0, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise EnvironmentFaultError(f"{engine!r} cannot be asked about containers: {error}") from None
