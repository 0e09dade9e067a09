"""The shape of the source: no import circles between rooms, few inside, type hints included; one class for one name."""

from __future__ import annotations

import ast
import functools
import re
from collections import defaultdict
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = {"": "riot_bus", "adapters/": "riot_bus_*"}
SHORT_TEXT = re.compile(
    r"^ +[a-z_]\w*: (?=.{1,14}$)"
    r"(All|As|At|By|From|How|In|Likewise|Of|That|To|What|When|Where|Which|Who|Whom|Whose)\b.*\.$(?!\n {5})",
    re.MULTILINE,
)
"""An argument or attribute whose whole text has less than 15 characters and begins with no noun."""
CIRCLES = [
    {"riot_bus.log.editing.batch", "riot_bus.log.editing.inputs"},
    {
        "riot_bus.router.advanced.history_mirror",
        "riot_bus.router.advanced.publisher_proxies",
        "riot_bus.router.delivery_queue",
    },
]
"""Circles that there are; the list may only get shorter."""


@functools.cache
def sources() -> dict[str, ast.Module]:
    """Return the syntax tree of each module by its name."""
    found = {}
    for above, pattern in FOLDERS.items():
        for package in (ROOT / above).glob(pattern):
            for path in package.rglob("*.py"):
                parts = path.relative_to(ROOT / above).with_suffix("").parts
                found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = ast.parse(path.read_bytes())
    return found


def imports(name: str, tree: ast.Module, known: dict[str, ast.Module]) -> Iterator[str]:
    """Yield the modules of ours that a module imports, anywhere in it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names if each.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for each in node.names:
                full = f"{node.module}.{each.name}"
                found = full if full in known else node.module
                if found in known and found != name and not name.startswith(f"{found}."):
                    yield found


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    """Return sets of modules that import each other; of each circle that is found, one link is cut before the next."""
    graph, found = {name: set(targets) for name, targets in graph.items()}, []
    while True:
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as error:
            circle = error.args[1]
            found.append(set(circle))
            graph[circle[1]].discard(circle[0])
        else:
            return found


def test_no_circle_between_rooms_and_only_these_inside() -> None:
    known = sources()
    graph = {name: set(imports(name, tree, known)) for name, tree in known.items() if name != "riot_bus"}
    rooms: dict[str, set[str]] = defaultdict(set)
    for name, targets in graph.items():
        rooms[room(name)] |= {room(target) for target in targets} - {room(name)}
    assert circles(rooms) == []
    assert {frozenset(each) for each in circles(graph)} <= {
        frozenset(part) for whole in CIRCLES for part in subsets(whole)
    }


def test_short_texts_of_arguments_have_a_noun() -> None:
    """`block: Which.` says nothing to who has not written it."""
    found = [
        f"{name}: {each[0].strip()}"
        for name, tree in sources().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        for each in SHORT_TEXT.finditer(ast.get_docstring(node) or "")
    ]
    assert found == []


def test_no_two_public_classes_have_one_name() -> None:
    places = defaultdict(list)
    for name, tree in sources().items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(name)
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def room(name: str) -> str:
    return ".".join(name.split(".")[: 2 if name.startswith("riot_bus.") else 1])


def subsets(whole: set[str]) -> Iterator[set[str]]:
    yield whole
    for each in whole:
        yield whole - {each}
