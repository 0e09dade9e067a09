"""Evidence of a failing trial, kept for debugging: printed text, stacks, outputs and resources."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import asdict
from typing import TYPE_CHECKING

from riot_bus.log.writer import LogWriter
from riot_bus.trial.processes import FIXED, fixes_addresses

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from riot_bus.monitors.model import TrialView
    from riot_bus.system.system_file import Component
    from riot_bus.trial.context import Context
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import Violation

_MOST_OUTPUT = 16 << 20
_FATAL = "SIGSEGV SIGABRT SIGBUS SIGFPE SIGILL SIGTRAP"
DEBUGGER = (
    *("gdb", "-q", "-nx", "-batch"),
    *("-ex", "set confirm off", "-ex", "handle all nostop noprint pass", "-ex", f"handle {_FATAL} stop print"),
    *("-ex", "run", "-ex", "echo \\nriot: backtrace\\n", "-ex", "backtrace 60", "--args"),
)
"""Prefix of a component's command that prints the native stack when a signal ends the component."""


def write_evidence(
    folder: Path, view: TrialView, violations: Sequence[Violation], *, context: Context
) -> dict[str, int]:
    """Write the evidence of a trial into files of a folder, each bounded in size.

    Returns:
        The size of each file in bytes, by name.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for component in view.components:
        texts = {"stdout": component.printed, "stderr": component.errors, "stacks": component.signs.stacks}
        texts["native"] = "".join(f"{file}: {function}\n" for file, function in component.stack)
        for name, text in texts.items():
            if text.strip():
                (folder / f"{component.name}.{name}.txt").write_text(text, encoding="utf-8")
        with (folder / f"{component.name}.resources.csv").open("w", newline="", encoding="utf-8") as stream:
            rows = csv.writer(stream, lineterminator="\n")
            rows.writerow(["time_ns", "messages", "memory_bytes", "files", "threads"])
            rows.writerows(asdict(sample).values() for sample in component.resources)
    _write_outputs(folder / "outputs.mcap", view.outputs, context)
    found = {
        "violations": [asdict(violation) for violation in violations],
        "status": {component.name: component.status for component in view.components},
        "commands": {each.name: _started(context.file.components[each.name]) for each in view.components},
        **_surroundings(context, [each.name for each in view.components]),
    }
    (folder / "trial.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return {path.name: path.stat().st_size for path in sorted(folder.iterdir())}


def _surroundings(context: Context, names: Sequence[str]) -> dict[str, object]:
    """Return the fixed surroundings of the trial: variables of each component, and whether addresses are fixed."""
    if context.file.system.surroundings != "fixed":
        return {"surroundings": "as they are", "addresses": "random"}
    own = {name: context.file.components[name].env for name in names}
    variables = {name: {key: env.get(key, value) for key, value in FIXED.items()} for name, env in own.items()}
    addresses = "the same each time" if fixes_addresses() else "random: the kernel lets no process fix them"
    return {"surroundings": variables, "addresses": addresses}


def _started(component: Component) -> list[str]:
    """Return the command of a component, preceded by the image of its container, if any."""
    return [*([component.container.image] if component.container else []), *component.command]


def _write_outputs(path: Path, outputs: Sequence[Message], context: Context) -> None:
    """Write the last outputs that fit into the size limit."""
    size, first = 0, len(outputs)
    while first and size + len(outputs[first - 1].payload) <= _MOST_OUTPUT:
        first -= 1
        size += len(outputs[first].payload)
    path.unlink(missing_ok=True)
    with LogWriter(path, registry=context.registry, profile=context.profile, metadata={"left out": str(first)}) as log:
        for message in outputs[first:]:
            log.write(message)


def has_debugger() -> bool:
    """Return whether the debugger that prints native stacks is installed."""
    return shutil.which(DEBUGGER[0]) is not None


def native_backtrace(printed: str) -> str:
    """Return the native stacks in the output of a component run by `DEBUGGER`; empty if there are none."""
    return printed.partition("riot: backtrace\n")[2].strip()[-256 << 10 :]
