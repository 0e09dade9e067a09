"""Hook that leaves out some of the processes that a process starts, by their names.

Python imports this by itself, as components with `only` put this folder first on PYTHONPATH. The file that
`RIOT_PLACEMENT` names says what to do: `only`, or the `hook` of an extension, a file that changes what is started in
another way. The hook changes `subprocess.Popen`, with which launch, `ros2 run` and most programs start processes:
commands, their names and prefixes stay as they are. Nothing else changes: another `sitecustomize` is imported as it
would be without this one. Standard library only.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

TYPE_CHECKING = False

_FOLDER = os.path.dirname(os.path.abspath(__file__))
_INTERPRETER = re.compile(r"(?:python|pypy)[0-9.]*t?")
_NODE = re.compile(r"(?:^|:)__(?:node|name):=(.+)")
_NAMESPACE = re.compile(r"(?:^|:)__ns:=(.+)")
_WITH_VALUE = ("-W", "-X")
_WAITS = {"run", "call"}
"""Functions of `subprocess` that wait for the end of the process; other such functions call one of these."""
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


def report(file: str, **event: object) -> None:
    """Report what is started, as a line of a file."""
    try:
        number = os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC)
    except OSError:  # riot is gone
        return
    try:
        if os.fstat(number).st_size < _LARGEST:
            os.write(number, json.dumps(event).encode()[:4096] + b"\n")
    finally:
        os.close(number)


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
    report(plan["told"], names=names[:8], segment="only" if wanted else "")


def patch(plan: Mapping[str, Any], change: Callable[[Mapping[str, Any], dict[str, Any]], None]) -> None:
    """Change the arguments of each process that this one starts, as a plan says."""
    import functools
    import subprocess

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
        patch(plan, _of_extension(plan) if "hook" in plan else chosen)


def _of_extension(plan: Mapping[str, Any]) -> Callable[[Mapping[str, Any], dict[str, Any]], None]:
    """Return what an extension's `begin(plan, tools)` gives; the tools are the functions of this module for names."""
    import importlib.util
    import types

    found: Any = importlib.util.spec_from_file_location("riot_placement", plan["hook"])
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    change: Callable[[Mapping[str, Any], dict[str, Any]], None] = module.begin(
        plan, types.SimpleNamespace(words_of=words_of, names_of=names_of, report=report)
    )
    return change


if not hasattr(sys, "_riot_placement"):  # else a chained hook imports this one again
    sys._riot_placement = True  # type: ignore[attr-defined]
    if "RIOT_PLACEMENT" in os.environ:
        _begin(os.environ["RIOT_PLACEMENT"])
    _chain()
