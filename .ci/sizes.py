"""What the source weighs: lines by room, circles of imports, numeric constants: `python3 .ci/sizes.py [ROOT]`.

A room is a package of riot_bus, a package of its `chain`, an extension or an adapter. Circles are counted with imports
inside functions and for type hints. A numeric constant is an assignment at the level of a module whose value, an
element of it, or the left side of a shift is a number.
"""

import ast
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(sys.argv[1] if len(sys.argv) > 1 else __file__).resolve()
ROOT = ROOT if ROOT.is_dir() else ROOT.parents[1]
FOLDERS = {"": "riot_bus", "adapters": "riot_bus_*", "extensions": "riot_bus_*"}


def sources() -> dict[str, Path]:
    """Return the file of each module by its name."""
    found = {}
    for above, pattern in FOLDERS.items():
        for path in (each for package in (ROOT / above).glob(pattern) for each in package.rglob("*.py")):
            parts = path.relative_to(ROOT / above).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def room(name: str) -> str:
    """Return the room of a module."""
    depth = 3 if name.startswith("riot_bus.chain.") else 2 if name.startswith("riot_bus.") else 1
    return ".".join(name.split(".")[:depth])


def imports(name: str, tree: ast.AST, known: dict[str, Path]) -> Iterator[str]:
    """Yield the modules of ours that a module imports, anywhere in it; not the packages that it lies in."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names if each.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for each in node.names:
                full = f"{node.module}.{each.name}"
                target = full if full in known else node.module
                if target in known and target != name and not name.startswith(f"{target}."):
                    yield target


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    """Return the strongly connected parts of more than one node (Tarjan's algorithm, by reachability)."""

    def reached(start: str) -> set[str]:
        seen, rest = {start}, [start]
        while rest:
            new = graph.get(rest.pop(), set()) - seen
            seen |= new
            rest += new
        return seen

    all_reached = {name: reached(name) for name in graph}
    parts = {frozenset(other for other in all_reached[name] if name in all_reached.get(other, ())) for name in graph}
    return [set(part) for part in parts if len(part) > 1]


def is_number(value: ast.expr | None) -> bool:
    """Return whether a value is a number, a group with one, or a number shifted."""
    if isinstance(value, ast.Tuple | ast.List | ast.Set):
        return any(map(is_number, value.elts))
    if isinstance(value, ast.UnaryOp):
        return is_number(value.operand)
    if isinstance(value, ast.BinOp):
        return is_number(value.left)
    return isinstance(value, ast.Constant) and type(value.value) in (int, float)


def names(node: ast.Assign | ast.AnnAssign) -> int:
    """Return how many names an assignment binds."""
    target = node.targets[0] if isinstance(node, ast.Assign) else node.target
    return len(target.elts) if isinstance(target, ast.Tuple) else 1


def main() -> None:
    """Print the figures."""
    files = sources()
    trees = {name: ast.parse(path.read_bytes()) for name, path in files.items()}
    lines: Counter[str] = Counter()
    constants: Counter[str] = Counter()
    graph = {name: set(imports(name, tree, files)) for name, tree in trees.items()}
    rooms: dict[str, set[str]] = defaultdict(set)
    for name, tree in trees.items():
        lines[room(name)] += len(files[name].read_bytes().splitlines())
        constants[room(name)] += sum(
            names(node) for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign) and is_number(node.value)
        )
        if name != "riot_bus":
            rooms[room(name)] |= {room(target) for target in graph[name]} - {room(name)}
    core = sum(count for name, count in lines.items() if name.split(".")[0] == "riot_bus")
    for name, count in lines.most_common():
        share = f"{100 * count / core:5.1f} % of core" if name.startswith("riot_bus.") else ""
        print(f"{count:7,}  {constants[name]:4} constants  {name:28} {share}")
    print(f"\ncore {core:,} lines, whole {sum(lines.values()):,}; numeric constants {sum(constants.values()):,}")
    packages = {name for name, path in files.items() if path.name == "__init__.py"}
    inside = circles({name: targets for name, targets in graph.items() if name not in packages})
    print(f"circles between rooms: {circles(rooms) or 'none'}; between modules: {inside or 'none'}")


if __name__ == "__main__":
    main()
