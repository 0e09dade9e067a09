"""Each module has its test file, or stands in tests/untested_modules.txt, which only gets shorter.

The file of riot_bus/room/module.py is tests/unit/room/test_module.py; that of adapters/riot_bus_ros2/module.py is
tests/unit/riot_bus_ros2/test_module.py. What needs processes may be in tests/integration or tests/property instead, as
test_room_module.py, or as test_module.py if no other module has that name.

    python tests/unit/test_every_module_has_tests.py > tests/untested_modules.txt      after a module got its tests
"""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIST = ROOT / "tests/untested_modules.txt"
SOURCES = ("riot_bus", "adapters/riot_bus_mavlink", "adapters/riot_bus_ros2", "extensions")
FLAT = ("integration", "property")


def modules() -> list[str]:
    """Return the paths of all modules that define a function or a class."""
    files = (path for source in SOURCES for path in (ROOT / source).rglob("*.py"))
    return sorted(str(path.relative_to(ROOT)) for path in files if _has_code(path))


def untested() -> list[str]:
    """Return the paths of the modules that have no test file."""
    every = modules()
    count = Counter(Path(module).stem for module in every)
    flat = {path.stem for folder in FLAT for path in (ROOT / "tests" / folder).glob("test_*.py")}
    missing = []
    for module in every:
        *rooms, stem = Path(module).with_suffix("").parts[1:]
        mirror = ROOT / "tests/unit" / Path(*rooms) / f"test_{stem}.py"
        names = {"_".join(("test", *rooms, stem)), *(["test_" + stem] if count[stem] == 1 else [])}
        if not mirror.exists() and not names & flat:
            missing.append(module)
    return missing


def test_modules_without_a_test_file_are_those_of_the_list() -> None:
    listed = LIST.read_text(encoding="utf-8").splitlines()
    missing = untested()
    assert [module for module in missing if module not in listed] == [], "write tests for these"
    assert [module for module in listed if module not in missing] == [], "these have tests or are gone: take them out"
    assert listed == sorted(set(listed))


def _has_code(path: Path) -> bool:
    definitions = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    return any(isinstance(each, definitions) for each in ast.parse(path.read_bytes()).body)


if __name__ == "__main__":
    print("\n".join(untested()))
