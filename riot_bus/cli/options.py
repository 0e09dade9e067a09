"""Options that several commands share, declared once."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from riot_bus.vocabulary.flags import Flag
from riot_bus.vocabulary.flags import Seed as SeedFlag

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


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """Options that say how the steps of the chain run: where they write, and on what; declared here alone."""

    out: Annotated[Path, Flag("Folder for everything that is written.", "--out -o", env="RIOT_OUT")] = DEFAULT_OUT
    seed: SeedFlag = 0
    jobs: Annotated[
        int,
        Flag(
            "Trials at once; 0: one per processor, more if the unit mostly waits.",
            "--jobs -j",
            env="RIOT_JOBS",
            least=0,
        ),
    ] = 0
    executor: Annotated[
        str | None, Flag("Cluster whose workers execute trials: dask://HOST:PORT.", env="RIOT_EXECUTOR")
    ] = None
    reports: Annotated[
        Sequence[str],
        Flag(
            "Keep a report up to date: junit, sarif, markdown, github, or one of another package; repeatable.",
            "--report",
            "NAME[=FILE]",
        ),
    ] = ()
    form: Annotated[
        StreamFormat,
        Flag("Form of the result on stdout; ndjson: events as they happen.", "--format", env="RIOT_FORMAT"),
    ] = StreamFormat.TEXT


System = Annotated[Path, typer.Option("--system", "-s", envvar="RIOT_SYSTEM", help="System file.", show_default=True)]
FindingsSystem = Annotated[
    Path | None,
    typer.Option(
        "--system",
        "-s",
        envvar="RIOT_SYSTEM",
        help="System file. [default: riot.toml; for reading logs, the finding's]",
    ),
]
UnitName = Annotated[
    str | None, typer.Option("--unit", "-u", envvar="RIOT_UNIT", help="Unit to test, if there are several.")
]
Format = Annotated[OutputFormat, typer.Option("--format", envvar="RIOT_FORMAT", help="Form of the result on stdout.")]
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
