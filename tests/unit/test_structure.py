"""The shape of the source: no import circles between rooms, few inside, type hints included; one class for one name."""

from __future__ import annotations

import ast
import functools
import re
import runpy
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
SIZES: dict[str, Any] = runpy.run_path(str(ROOT / ".ci" / "sizes.py"))
imports, room, circles = SIZES["imports"], SIZES["room"], SIZES["circles"]
FOLDERS = {"": "riot_bus", "adapters/": "riot_bus_*", "dictionaries/": "riot_bus_*", "extensions/": "riot_bus_*"}
SHORT_TEXT = re.compile(r"^ +[*`]*(?:[A-Za-z_]\w*)`?: (.{1,14})$(?!\n {5})", re.MULTILINE)
"""An argument or attribute whose whole text has less than 15 characters."""

QUESTION = re.compile(
    r"^ +[*`]*(?:[A-Za-z_]\w*)`?: ((?:How|What|When|Where|Which|Who|Whom|Whose|Why)\b.*)", re.MULTILINE
)
"""An argument or attribute whose text is a question, not a noun."""

SECTIONS = re.compile(r"^(?:Args|Attributes|Yields|Returns):\n((?: +.*\n?|\n)+)", re.MULTILINE)
NO_NOUN = (
    "a again all also always an and any are as asked at be both by default done each either every false few for from "
    "given go goes has here how if in into is it its kept less like likewise made many more most much needed never no "
    "none not null of on once one ones only optional or other others out own required same see set so some such taken "
    "that the their them then there these they this those to true used wanted was what whatever when where whether "
    "which whichever who whoever whom whose why will with without would yes"
)
"""Words that name nothing, nor do texts of these alone."""

FACTORIES = frozenset(
    {"Enum", "IntEnum", "NamedTuple", "NewType", "StrEnum", "TypedDict", "make_dataclass", "namedtuple"}
)
FIRST = "all as at by from how in likewise of that to what when where which who whom whose why"
"""Words with which a text of a few words does not say what the argument is."""

CIRCLES: list[set[str]] = []
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


def test_no_circle_between_rooms_and_only_these_inside() -> None:
    known = sources()
    graph = {name: set(imports(name, tree, known)) for name, tree in known.items() if name != "riot_bus"}
    rooms: dict[str, set[str]] = defaultdict(set)
    packages = {name.rpartition(".")[0] for name in known}
    for name, targets in graph.items():
        here = room(name, packages)
        rooms[here] |= {room(target, packages) for target in targets} - {here}
    assert circles(rooms) == []
    assert {frozenset(each) for each in circles(graph)} <= {
        frozenset(part) for whole in CIRCLES for part in subsets(whole)
    }


def texts(tree: ast.Module) -> Iterator[str]:
    """Yield the docstrings of a module, its classes and functions, nested ones too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield ast.get_docstring(node) or ""


def without_noun(docstring: str) -> list[str]:
    """Return the texts of arguments and attributes that are questions, or below 15 characters and name nothing."""
    found = []
    for section in SECTIONS.finditer(docstring):
        for text in SHORT_TEXT.findall(section[1]):
            words = re.findall(r"[a-z]+", text.lower())
            if not words or words[0] in FIRST.split() or set(words) <= set(NO_NOUN.split()):
                found.append(text)
        found += [text for text in QUESTION.findall(section[1]) if text not in found]
    return found


def test_texts_of_arguments_have_a_noun() -> None:
    """`block: Which.` says nothing to who has not written it."""
    places = {name: [text for each in texts(tree) for text in without_noun(each)] for name, tree in sources().items()}
    assert {name: found for name, found in places.items() if found} == {}


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("block: Which.", ["Which."]),
        ("*sessions: Whose", ["Whose"]),
        ("`block`: As above", ["As above"]),
        ("**more: If given.", ["If given."]),
        ("Most: See there.", ["See there."]),
        ("block: ?", ["?"]),
        ("block: The log.", []),
        ("block: Which log it is.", ["Which log it is."]),
        ("block: What is\n        sent.", ["What is"]),
        ("block: Whether it is\n        sent.", []),
    ],
)
def test_what_names_nothing(line: str, told: list[str]) -> None:
    assert without_noun(f"Do.\n\nArgs:\n    {line}\n") == told


def classes(node: ast.AST) -> Iterator[str]:
    """Yield the names of public classes; those in functions and in private classes are not public."""
    for each in ast.iter_child_nodes(node):
        hidden = isinstance(each, ast.ClassDef) and each.name.startswith("_")
        if hidden or isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        if isinstance(each, ast.ClassDef):
            yield each.name
        yield from classes(each)


def made_classes(tree: ast.Module) -> Iterator[str]:
    """Yield the names of public classes that a call makes: `Place = NamedTuple(...)`."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call):
            made = ast.unparse(node.value.func).rpartition(".")[2] in FACTORIES
            yield from (target.id for target in node.targets if made and isinstance(target, ast.Name))


def test_no_two_public_classes_have_one_name() -> None:
    places = defaultdict(list)
    for name, tree in sources().items():
        for each in (*classes(tree), *made_classes(tree)):
            if not each.startswith("_"):
                places[each].append(name)
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_which_classes_are_public() -> None:
    text = """
if True:
    class A:
        class B: ...
        class _C:
            class D: ...
def make():
    class E: ...
F = NamedTuple("F", [])
"""
    tree = ast.parse(text)
    assert [*classes(tree), *made_classes(tree)] == ["A", "B", "F"]


def subsets(whole: set[str]) -> Iterator[set[str]]:
    yield whole
    for each in whole:
        yield whole - {each}


def own_programs(tree: ast.Module) -> Iterator[list[str]]:
    """Yield the command lists that start our own Python, with each word that is no literal text as "..."."""
    for node in ast.walk(tree):
        if isinstance(node, ast.List) and node.elts and ast.unparse(node.elts[0]) == "sys.executable":
            yield [ast.literal_eval(each) if isinstance(each, ast.Constant) else "..." for each in node.elts[1:]]


def test_no_module_of_the_working_folder_is_imported_by_what_riot_starts() -> None:
    found = {name: commands for name, tree in sources().items() if (commands := list(own_programs(tree)))}
    assert {"riot_bus_conformance.conductor", "riot_bus.pool.local"} <= set(found)
    scripts = {"riot_bus.processes.launcher"}  # a script's own folder is searched, not the working folder
    for name, commands in found.items():
        for words in commands:
            assert ("-P" in words) == (name not in scripts), (name, words)
            assert bool({"-m", "-c"} & set(words)) == (name not in scripts), (name, words)
