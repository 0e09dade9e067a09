"""Options that several commands share, declared once."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

__all__ = [
    "DEFAULT_OUT",
    "DEFAULT_SYSTEM",
    "CatalogueFile",
    "Definitions",
    "EventFormat",
    "Executor",
    "Finding",
    "FindingsSystem",
    "Format",
    "Jobs",
    "Out",
    "OutputFormat",
    "Reports",
    "Salvage",
    "Seed",
    "StreamFormat",
    "System",
    "Tolerance",
    "ToleranceFile",
    "Types",
    "UnitName",
]

DEFAULT_SYSTEM = Path("riot.toml")
DEFAULT_OUT = Path("riot-out")


class OutputFormat(StrEnum):
    """Forms of results on stdout."""

    TEXT = "text"
    JSON = "json"


class StreamFormat(StrEnum):
    """Forms of results on stdout, for commands that can also write events as they happen."""

    TEXT = "text"
    JSON = "json"
    NDJSON = "ndjson"


System = Annotated[Path, typer.Option("--system", "-s", envvar="RIOT_SYSTEM", help="System file.", show_default=True)]
FindingsSystem = Annotated[
    Path | None,
    typer.Option("--system", "-s", envvar="RIOT_SYSTEM", help="System file. [default: the finding's]"),
]
Out = Annotated[Path, typer.Option("--out", "-o", envvar="RIOT_OUT", help="Folder for everything that is written.")]
Jobs = Annotated[
    int,
    typer.Option(
        "--jobs",
        "-j",
        envvar="RIOT_JOBS",
        min=0,
        help="Trials at once; 0: one per processor, more if the unit mostly waits.",
    ),
]
Executor = Annotated[
    str | None,
    typer.Option("--executor", envvar="RIOT_EXECUTOR", help="Cluster whose workers execute trials: dask://HOST:PORT."),
]
Seed = Annotated[int, typer.Option("--seed", envvar="RIOT_SEED", help="Seed of everything random.")]
UnitName = Annotated[
    str | None, typer.Option("--unit", "-u", envvar="RIOT_UNIT", help="Unit to test, if there are several.")
]
Format = Annotated[OutputFormat, typer.Option("--format", envvar="RIOT_FORMAT", help="Form of the result on stdout.")]
EventFormat = Annotated[
    StreamFormat,
    typer.Option("--format", envvar="RIOT_FORMAT", help="Form of the result on stdout; ndjson: events as they happen."),
]
Reports = Annotated[
    list[str] | None,
    typer.Option(
        "--report",
        metavar="NAME[=FILE]",
        help="Keep a report up to date: junit, sarif, allure, markdown, github, or one of another package; repeatable.",
    ),
]
Types = Annotated[
    list[str] | None, typer.Option("--type", metavar="TOPIC=TYPE", help="Type of a topic's messages; repeatable.")
]
Definitions = Annotated[
    list[Path] | None,
    typer.Option("--msg", metavar="FILE", help="File that defines message types: .msg, .desc, ...; repeatable."),
]
Salvage = Annotated[
    bool, typer.Option("--salvage", help="Also read messages of damaged chunks, as far as an index confirms them.")
]
Tolerance = Annotated[
    list[str] | None,
    typer.Option(
        metavar="TOPIC[:PATH]=HOW_FAR",
        help="Allowed difference: of values TOPIC:PATH=0.01, =1% or =ignore; of counts TOPIC=5; repeatable.",
    ),
]
ToleranceFile = Annotated[
    list[Path] | None,
    typer.Option(
        "--tolerances", metavar="FILE.toml", help="File of tolerances, as riot diff --propose writes it; repeatable."
    ),
]
Finding = Annotated[Path, typer.Argument(help="Folder of a finding, or an output folder that holds just one.")]
CatalogueFile = Annotated[
    Path | None,
    typer.Option(
        "--catalogue",
        metavar="FILE",
        envvar="RIOT_CATALOGUE",
        help="The catalogue. [default: riot/catalogue.sqlite in $XDG_DATA_HOME]",
    ),
]
