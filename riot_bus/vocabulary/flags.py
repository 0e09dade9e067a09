"""How options of commands are declared: as fields of dataclasses, with a `Flag` each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import Field, dataclass, fields
from pathlib import Path
from typing import Annotated, Any


@dataclass(frozen=True, slots=True)
class Flag:
    """How a field of a command's options is written: `Annotated[float, Flag("Speed.", "-r")]`, in a dataclass.

    The command line, its reference and the requests to a robot's agent are made from it.

    Attributes:
        help: Text for `--help`.
        names: Names on the command line, separated by spaces; `--field-name` is added if none begins with `--`.
        metavar: Placeholder of the value.
        env: Environment variable that stands for the option.
        read: Function that turns the user's text into the value, or all texts of a repeatable option; gets the option's
            name, for errors.
        text: The default as a user would write it, for `read`.
        least: Smallest number.
        most: Greatest number.
        remote: Whether it may be requested of a robot; for numbers, optionally the least and the greatest.
    """

    help: str
    names: str = ""
    metavar: str | None = None
    env: str | None = None
    read: Callable[[Any, str], Any] | None = None
    text: str | None = None
    least: float | None = None
    most: float | None = None
    remote: bool | tuple[float, float] = False


Types = Annotated[Sequence[str], Flag("Type of a topic's messages; repeatable.", "--type", "TOPIC=TYPE", remote=True)]
Definitions = Annotated[
    Sequence[Path], Flag("File that defines message types: .msg, .desc, ...; repeatable.", "--msg", "FILE")
]
Interceptors = Annotated[
    Sequence[str],
    Flag(
        "A shipped interceptor (riot interceptors), or your own class; repeatable, carried out in this order.",
        "--interceptor",
        "'NAME key=value ...'|FILE.py[:NAME]",
    ),
]
Seed = Annotated[int, Flag("Seed of everything that is random.", env="RIOT_SEED", remote=True)]
Salvage = Annotated[bool, Flag("Also read messages of damaged chunks, as far as an index confirms them.")]


def flags_of(kind: type) -> list[tuple[Field[Any], Flag, list[str]]]:
    """Return the fields of a dataclass that are options, and how: declaration and names, the first one for errors."""
    found = []
    for field in fields(kind):
        for flag in getattr(field.type, "__metadata__", ()):
            long = field.name.replace("_", "-")
            names = flag.names.split()
            if not flag.names.startswith("--"):
                names.insert(0, f"--{long}/--no-{long}" if field.default is True else f"--{long}")
            found.append((field, flag, names))
    return found
