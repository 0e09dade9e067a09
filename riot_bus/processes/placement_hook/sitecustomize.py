"""Hook that gives started processes the environment of another segment, or leaves them out, by their names.

Python imports this by itself, as `riot ros-test` and components with `only` put this folder first on PYTHONPATH. The
file that `RIOT_PLACEMENT` names says what to do. The hook changes `subprocess.Popen`, with which launch,
launch_testing, launch_pytest, `ros2 run`, colcon and most test suites start processes: commands, their names and
prefixes stay as they are, only variables are added; the tests of each package get a router. A Zenoh session that would
look for others by scouting connects to its segment. Nothing else changes: another `sitecustomize` is imported as it
would be without this one. Standard library only.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from typing import Any

_FOLDER = os.path.dirname(os.path.abspath(__file__))
_INTERPRETER = re.compile(r"(?:python|pypy)[0-9.]*t?")
_NODE = re.compile(r"(?:^|:)__(?:node|name):=(.+)")
_NAMESPACE = re.compile(r"(?:^|:)__ns:=(.+)")
_WITH_VALUE = ("-W", "-X")
_WAITS = {"run", "call"}
"""Functions of `subprocess` that wait for the end of the process; other such functions call one of these."""
_TEST_PROGRAMS = {"ctest", "pytest", "unittest"}
_SEARCHES = ("connect/endpoints", "listen/endpoints", "scouting/multicast/enabled")
"""Keys of Zenoh's configuration that have their defaults where a session looks for others by scouting."""
_LARGEST = 1 << 18
"""Size limit of the file of reports, in bytes."""


def words_of(command: object, *, shell: bool = False) -> list[str]:
    """Return the words of a command as `subprocess.Popen` takes it; a shell command is split into its words."""
    import shlex

    if isinstance(command, (str, bytes, os.PathLike)):
        text = os.fsdecode(command)
        if not shell:
            return [text]
        try:
            return shlex.split(text)
        except ValueError:
            return text.split()
    return [os.fsdecode(word) for word in command]  # type: ignore[attr-defined]


def names_of(words: Sequence[str]) -> list[str]:
    """Return the names of a command: its program, the script or module that Python runs, its ROS node."""
    found = [os.path.basename(words[0])]
    if _INTERPRETER.fullmatch(found[0]):
        found += _python_names(words[1:])
    found += [name[:-3] for name in found if name.endswith(".py")]
    nodes = [match.group(1) for match in map(_NODE.search, words) if match]
    spaces = [match.group(1) for match in map(_NAMESPACE.search, words) if match]
    found += [f"{space.rstrip('/')}/{node}" for node in nodes[-1:] for space in spaces[-1:] or [""]]
    return [*found, *nodes[-1:]]


def _python_names(words: Sequence[str]) -> list[str]:
    rest = iter(words)
    for word in rest:
        if word == "-m":
            return [next(rest, "")]
        if word in _WITH_VALUE:
            next(rest, "")
        elif word == "-c" or not word.startswith("-"):
            return [] if word == "-c" else [os.path.basename(word)]
    return []


def placed(plan: Mapping[str, Any], popen: dict[str, Any]) -> None:
    """Change the arguments of a `Popen` as a plan says, and report what was started.

    Args:
        plan: Plan with `segment`, `nodes` (regular expression, empty for none), `variables`, `told` (file of reports).
        popen: Arguments of `Popen` by name.
    """
    words = words_of(popen["args"], shell=bool(popen.get("shell")))
    names = names_of(words)
    program = popen.get("executable")
    if program is not None:
        names.append(os.path.basename(os.fsdecode(program)))
    chosen = bool(plan["nodes"]) and any(re.fullmatch(plan["nodes"], name) for name in names)
    if chosen:
        given = popen.get("env")
        popen["env"] = {**(os.environ if given is None else given), **plan["variables"]}
    _tell(plan["told"], names=names[:8], segment=plan["segment"] if chosen else "")


def _tell(file: str, **event: object) -> None:
    try:
        number = os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC)
    except OSError:  # riot is gone
        return
    try:
        if os.fstat(number).st_size < _LARGEST:
            os.write(number, json.dumps(event).encode()[:4096] + b"\n")
    finally:
        os.close(number)


def wrapped(plan: Mapping[str, Any], popen: dict[str, Any]) -> None:
    """Run the tests of one package in a separate `riot ros-test`, if this is colcon and starts them.

    Args:
        plan: Plan with `wrap`, the words to prepend, with `{package}` and `{folder}`, and `cwd`, their working folder.
        popen: Arguments of `Popen` by name.
    """
    words = words_of(popen["args"])
    if popen.get("shell") or "colcon" not in sys.argv[0] or not _TEST_PROGRAMS & set(names_of(words)):
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


def chosen(plan: Mapping[str, Any], popen: dict[str, Any]) -> None:
    """Replace a process that is not chosen by one that does nothing, so that its parent continues.

    Helpers for whose end `subprocess.run` and the like wait are started, such as a program that writes the parameters
    of a launch file. So is whatever a chosen process starts.

    Args:
        plan: Plan with `only` (regular expression for a whole name).
        popen: Arguments of `Popen` by name.
    """
    if sys._getframe(2).f_code.co_name in _WAITS and sys._getframe(2).f_globals.get("__name__") == "subprocess":
        return
    names = names_of(words_of(popen["args"], shell=bool(popen.get("shell"))))
    given, wanted = popen.get("env"), any(re.fullmatch(plan["only"], name) for name in names)
    if wanted:
        environment = dict(os.environ if given is None else given)
        environment.pop("RIOT_PLACEMENT", None)
        popen["env"] = environment
    else:
        popen.update(args=["sleep", "infinity"], executable=None, shell=False)
    _tell(plan["told"], names=names[:8], segment="only" if wanted else "")


def patch(plan: Mapping[str, Any]) -> None:
    """Apply a plan to each process that this one starts."""
    import functools
    import subprocess

    kinds: dict[str, Callable[[Mapping[str, Any], dict[str, Any]], None]] = {"wrap": wrapped, "only": chosen}
    change = next((kinds[name] for name in kinds if plan.get(name)), placed)
    original: Any = subprocess.Popen.__init__
    order = original.__code__.co_varnames[1 : original.__code__.co_argcount]

    @functools.wraps(original)
    def begin(self: Any, *arguments: Any, **options: Any) -> None:
        popen = {**dict(zip(order, arguments)), **options}  # noqa: B905 - for Python 3.8
        if len(arguments) > len(order) or "args" not in popen:
            original(self, *arguments, **options)
            return
        if not isinstance(popen["args"], (str, bytes, os.PathLike)):
            popen["args"] = list(popen["args"])  # an iterator can be read only once
        with contextlib.suppress(Exception):  # errors here must not reach the program
            change(plan, popen)
        original(self, **popen)

    subprocess.Popen.__init__ = begin  # type: ignore[method-assign]


def joined(zenoh: Any) -> None:
    """Make sessions that would look for others by scouting connect as the file in `ZENOH_CONFIG` says.

    `zenoh.Config()` does not read that file. A session whose configuration says where to connect or listen, or that
    must not look for others, is opened as it is.

    Args:
        zenoh: The module, whose `open` is replaced.
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


def _chain() -> None:
    """Import the `sitecustomize` that would have been found without this one."""
    import importlib.machinery
    import importlib.util

    rest = [folder for folder in sys.path if os.path.abspath(folder or ".") != _FOLDER]
    found = importlib.machinery.PathFinder.find_spec("sitecustomize", rest)
    if found is not None and found.loader is not None:
        found.loader.exec_module(importlib.util.module_from_spec(found))


def _begin(file: str) -> None:
    with contextlib.suppress(OSError, ValueError), open(file, encoding="utf-8") as stream:  # else riot is gone
        plan = json.load(stream)
        patch(plan)
        if "nodes" in plan and "ZENOH_CONFIG" in os.environ:
            sys.meta_path.insert(0, _Zenoh())


if not hasattr(sys, "_riot_placement"):  # else a chained hook imports this one again
    sys._riot_placement = True  # type: ignore[attr-defined]
    if "RIOT_PLACEMENT" in os.environ:
        _begin(os.environ["RIOT_PLACEMENT"])
    _chain()
