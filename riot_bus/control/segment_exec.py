"""`riot exec --segment NAME -- COMMAND`: becomes a command that is in a segment."""

from __future__ import annotations

import hashlib
import os
import signal
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NoReturn

from riot_bus.config.endpoints import split_endpoints
from riot_bus.control.component import client_cfg, segment_access
from riot_bus.control.environment import client_settings, reachable, session_file
from riot_bus.control.router_flags import RouterOptions
from riot_bus.control.segment_environment import (
    FILES,
    endpoints_of,
    export,
    exported_endpoints,
    segment_variables,
    write_session_files,
)
from riot_bus.given_files import private_folder
from riot_bus.vocabulary.errors import EnvironmentFaultError


def environment_in(
    segment: str,
    environ: Mapping[str, str],
    *,
    system: Path | None = None,
    host: str | None = None,
    cfg: Sequence[str] = (),
    hint: Callable[[str], None],
) -> dict[str, str]:
    """Return the whole environment of a command that is to run in a segment.

    Args:
        segment: `NAME`, or `NAME=ENDPOINT[,ENDPOINT...]`.
        environ: The environment so far.
        system: riot.toml; None for what a running router has exported, else for what `riot router` would take here:
            `RIOT_SYSTEM` and `RIOT_SEGMENT`, or riot.toml in the working folder, or none.
        host: The router's machine, for components elsewhere.
        cfg: `KEY=VALUE`, settings of the component.
        hint: Function that is told what is still missing.

    Raises:
        ConfigError: There is no such segment, it cannot be reached, or its file cannot be written.
    """
    name, given, listen = segment.partition("=")
    config, exported = client_cfg(cfg), not (given or system) and bool(exported_endpoints(environ))
    if exported and FILES in environ and not config and host is None:
        return {**environ, **segment_variables(name, environ)}
    if given:
        endpoints = reachable(split_endpoints(listen), host=host)
    elif exported:
        endpoints = reachable(endpoints_of(name, environ), host=host)
    else:
        if system is None and environ.get("RIOT_SYSTEM"):
            system = Path(environ["RIOT_SYSTEM"])
        options = RouterOptions(system=system, segments=environ.get("RIOT_SEGMENT", "").split())
        endpoints, config, hints = segment_access(name, options, config, host=host)
        for each in hints:
            hint(each)
    folder = session_files_folder(session_file(client_settings(endpoints, config)))
    write_session_files({name: endpoints}, folder, config=config)
    # This is not exported: children that are put into another segment look for it where this one was found.
    found = {**environ, **export({name: endpoints}, files=folder)}
    return {**environ, **segment_variables(name, found, config=config)}


def become(command: Sequence[str], environ: Mapping[str, str]) -> NoReturn:
    """Replace this process by a command, so that signals and exit status are the command's own.

    Raises:
        EnvironmentFaultError: It cannot be executed.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    for number in (signal.SIGPIPE, signal.SIGXFSZ):  # Python ignores them, which a command would inherit
        signal.signal(number, signal.SIG_DFL)
    try:
        os.execvpe(command[0], list(command), environ)  # noqa: S606 - no shell is what is wanted
    except OSError as error:
        raise EnvironmentFaultError(f"{command[0]!r} cannot be executed: {error.strerror or error}") from error


def session_files_folder(text: str) -> Path:
    """Return a folder for the files of one configuration that only this user can write to and that outlives `become`.

    The name is derived from the content of the file, so there is one folder for each configuration, however often it is
    used. The content of `$XDG_RUNTIME_DIR` is gone when the user logs out.

    Raises:
        ConfigError: Others may write there, or it cannot be made.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    root = Path(runtime) / "riot-bus" if runtime else Path(tempfile.gettempdir()) / f"riot-bus-{os.getuid()}"
    return private_folder(private_folder(root) / hashlib.sha256(text.encode()).hexdigest()[:16])
