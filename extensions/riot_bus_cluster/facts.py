"""Facts that an outcome depends on besides the test case, as two machines compare them: versions, riot.toml, code.

`python -m riot_bus_cluster.facts RIOT_TOML` prints it as JSON, in a process that has just loaded all of it.
"""

from __future__ import annotations

import hashlib
import json
import platform
import sys
from collections.abc import Mapping
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from riot_bus.trial.context import Context, open_system
from riot_bus.types.registry import chosen_adapters
from riot_bus.vocabulary.errors import RiotError

_OURS = ("riot_bus", "riot_bus_mavlink", "riot_bus_ros2", "riot_bus_dictionaries")


def facts_of(context: Context) -> dict[str, str]:
    """Return a version or a hash of each thing by its name."""
    python = ".".join(platform.python_version_tuple()[:2])
    versions = {"Python": python, "eclipse-zenoh": version("eclipse-zenoh"), "pydantic": version("pydantic")}
    return (
        versions
        | {"riot_bus": _own_code(), "adapters": str(chosen_adapters(context.file.system.adapters))}
        | {f"code {name}" if name != "riot.toml" else name: digest for name, digest in context.parts().items()}
    )


def differences(mine: Mapping[str, str], theirs: Mapping[str, str]) -> str:
    """Return as text what differs between this machine and that of riot; empty if nothing does."""
    names = [name for name in sorted({*mine, *theirs}) if mine.get(name) != theirs.get(name)]
    told = [f"{name} is {_shown(mine, name)} here, {_shown(theirs, name)} where riot runs" for name in names]
    more = [f"and {len(told) - 5} more"] if len(told) > 5 else []  # which make some 500 letters
    return "; ".join(told[:5] + more)


def _shown(facts: Mapping[str, str], name: str) -> str:
    return facts[name][:24] if name in facts else "missing"


def _own_code() -> str:
    digest = hashlib.sha256()
    for name in _OURS:
        spec = find_spec(name)
        for folder in spec.submodule_search_locations or () if spec else ():
            for path in sorted(path for end in ("*.py", "*.toml") for path in Path(folder).rglob(end)):
                digest.update(f"{name}/{path.relative_to(folder)}".encode())
                digest.update(hashlib.sha256(path.read_bytes()).digest())
    return f"{version('riot-bus')} {digest.hexdigest()[:16]}"


def main() -> None:
    """Print the facts of the named system file, or what is wrong with it."""
    try:
        print(json.dumps(facts_of(open_system(Path(sys.argv[1])))))  # noqa: T201
    except (RiotError, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
