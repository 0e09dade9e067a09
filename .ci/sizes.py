"""What the source weighs: lines by room, circles of imports, numeric constants: `python3 .ci/sizes.py [ROOT]`.

A room is what lies in riot_bus itself, a package or a module, or a whole adapter or extension; packages of
`riot_bus.chain` are rooms of their own. Circles are found with imports inside functions and for type hints. Numeric
constants are the names that assignments at the level of a module bind, where the value, an element of it, or the left
side of its operation is a number.
"""

import ast
import sys
from collections import Counter, defaultdict
from collections.abc import Container, Iterator, Mapping
from pathlib import Path

FOLDERS = {"": "riot_bus", "adapters": "riot_bus_*", "extensions": "riot_bus_*"}


def sources(root: Path) -> dict[str, Path]:
    """Return the file of each module of a checkout by its name."""
    found = {}
    for above, pattern in FOLDERS.items():
        for path in (each for package in (root / above).glob(pattern) for each in package.rglob("*.py")):
            parts = path.relative_to(root / above).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def room(name: str, packages: Container[str] = ()) -> str:
    """Return the room of a module; `packages` tells whether what lies in `chain` is a room or a module."""
    parts = name.split(".")
    inner = ".".join(parts[:3])
    if inner.startswith("riot_bus.chain.") and inner in packages:
        return inner
    return ".".join(parts[: 2 if parts[0] == "riot_bus" else 1])


def imports(name: str, tree: ast.AST, known: Mapping[str, object]) -> Iterator[str]:
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


def circles(graph: Mapping[str, set[str]]) -> list[set[str]]:
    """Return the strongly connected components of more than one node: nodes that all reach each other."""

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
    """Return whether a value is a number, a group with one, or an operation that begins with one."""
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
    root = Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).resolve().parents[1]
    files = sources(root)
    if "riot_bus" not in files:
        sys.exit(f"sizes.py: {root} is no checkout: there is no riot_bus/__init__.py; name its folder")
    packages = {name for name, path in files.items() if path.name == "__init__.py"}
    trees = {name: ast.parse(path.read_bytes()) for name, path in files.items()}
    lines: Counter[str] = Counter()
    constants: Counter[str] = Counter()
    graph = {name: set(imports(name, tree, files)) for name, tree in trees.items()}
    rooms: dict[str, set[str]] = defaultdict(set)
    for name, tree in trees.items():
        here = room(name, packages)
        lines[here] += len(files[name].read_bytes().splitlines())
        constants[here] += sum(
            names(node) for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign) and is_number(node.value)
        )
        if name != "riot_bus":
            rooms[here] |= {room(target, packages) for target in graph[name]} - {here}
    core = sum(count for name, count in lines.items() if name.split(".")[0] == "riot_bus")
    for name, count in lines.most_common():
        share = f"{100 * count / core:5.1f} % of core" if name.startswith("riot_bus.") else ""
        print(f"{count:7,}  {constants[name]:4} constants  {name:28} {share}")
    print(f"\ncore {core:,} lines, whole {sum(lines.values()):,}; numeric constants {sum(constants.values()):,}")
    inside = circles({name: targets for name, targets in graph.items() if name != "riot_bus"})
    print(f"circles between rooms: {circles(rooms) or 'none'}; between modules: {inside or 'none'}")


if __name__ == "__main__":
    main()
