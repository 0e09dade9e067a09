"""What `riot ros-test` changes of the processes that tests start, in these processes (see `placement_hook`).

Some get the variables of another segment, by their names; the tests of each package get a router. A Zenoh session that
would look for others by scouting connects to its segment. Standard library only, for the Python of the tests.
"""

from __future__ import annotations

import contextlib
import os
import re
import sys
from collections.abc import Callable, Mapping
from typing import Any

TYPE_CHECKING = False

_TEST_PROGRAMS = {"ctest", "pytest", "unittest"}
_SEARCHES = ("connect/endpoints", "listen/endpoints", "scouting/multicast/enabled")
"""Keys of Zenoh's configuration that have their defaults where a session looks for others by scouting."""


def begin(plan: Mapping[str, Any], tools: Any) -> Callable[[Mapping[str, Any], dict[str, Any]], None]:
    """Begin to carry out a plan; return what changes the arguments of each `Popen`."""
    if "nodes" in plan and "ZENOH_CONFIG" in os.environ:
        sys.meta_path.insert(0, _Zenoh())
    change = wrapped if "wrap" in plan else placed
    return lambda plan, popen: change(tools, plan, popen)


def placed(tools: Any, plan: Mapping[str, Any], popen: dict[str, Any]) -> None:
    """Change the arguments of a `Popen` as a plan says, and report what was started.

    Args:
        plan: Plan with `segment`, `nodes` (regular expression, empty for none), `variables`, `told` (file of reports).
    """
    words = tools.words_of(popen["args"], shell=bool(popen.get("shell")))
    names = tools.names_of(words)
    program = popen.get("executable")
    if program is not None:
        names.append(os.path.basename(os.fsdecode(program)))
    chosen = bool(plan["nodes"]) and any(re.fullmatch(plan["nodes"], name) for name in names)
    if chosen:
        given = popen.get("env")
        popen["env"] = {**(os.environ if given is None else given), **plan["variables"]}
    tools.report(plan["told"], names=names[:8], segment=plan["segment"] if chosen else "")


def wrapped(tools: Any, plan: Mapping[str, Any], popen: dict[str, Any]) -> None:
    """Run the tests of one package in a separate `riot ros-test`, if this is colcon and starts them.

    Args:
        plan: Plan with `wrap`, the words to prepend, with `{package}` and `{folder}`, and `cwd`, their working folder.
    """
    words = tools.words_of(popen["args"])
    if popen.get("shell") or "colcon" not in sys.argv[0] or not _TEST_PROGRAMS & set(tools.names_of(words)):
        return
    if "--show-only" in words:  # colcon asks whether there are any
        return
    folder = os.path.abspath(os.fsdecode(popen.get("cwd") or os.curdir))
    options = (popen.get("env") or os.environ).get("PYTEST_ADDOPTS", "")
    told = re.search(r"--junit-prefix=([\w.-]+)", options)
    package = told.group(1) if told else os.path.basename(folder)
    values = {"{package}": package, "{folder}": folder}
    popen["args"] = [*(values.get(word, word) for word in plan["wrap"]), *words]
    popen["cwd"] = plan["cwd"]


def joined(zenoh: Any) -> None:
    """Make sessions that would look for others by scouting connect as the file in `ZENOH_CONFIG` says.

    `zenoh.Config()` does not read that file. A session whose configuration says where to connect or listen, or that
    must not look for others, is opened as it is.
    """
    import functools

    original = zenoh.open

    @functools.wraps(original)
    def begin(config: Any, *arguments: Any, **options: Any) -> Any:
        with contextlib.suppress(Exception):  # errors here must not reach the program
            usual, ours = zenoh.Config(), zenoh.Config.from_env()
            alike = all(config.get_json(key) == usual.get_json(key) for key in _SEARCHES)
            if alike and config.get_json("mode") != '"router"':
                config = type(config).from_json5(str(config))  # the program may use its own again
                for key in ("mode", *_SEARCHES):
                    config.insert_json5(key, ours.get_json(key))
        return original(config, *arguments, **options)

    zenoh.open = begin


class _Zenoh:
    """Finder that applies `joined` to zenoh when it is imported."""

    def find_spec(self, name: str, _path: object = None, _target: object = None) -> Any:
        if name != "zenoh" or self not in sys.meta_path:
            return None
        import importlib.util

        sys.meta_path.remove(self)
        found = importlib.util.find_spec(name)
        if found is not None and found.loader is not None:
            load = found.loader.exec_module

            def exec_module(module: Any) -> None:
                load(module)
                joined(module)

            found.loader.exec_module = exec_module  # type: ignore[method-assign]
        return found
