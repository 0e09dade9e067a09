"""What is done with each broken log: run in a process of its own, with a limit of memory and of time.

`python -m tests.log_actions FOLDER FIRST STEP` does it with every STEPth mutant and prints a line of JSON for each.
"""

from __future__ import annotations

import contextlib
import dataclasses
import faulthandler
import io
import json
import resource
import shutil
import signal
import sys
import traceback
from collections.abc import Callable
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

from riot_bus.vocabulary.errors import RiotError

MOST_MEMORY = 3 << 29  # beyond what is there at the beginning
MOST_SECONDS = 90

Action = Callable[[Path], Any]


class TooSlowError(BaseException):
    """An action does not come to an end."""


def read(path: Path) -> dict[str, Any]:
    """Read everything a reader gives, as a player does too."""
    from riot_bus.log.reader import LogReader

    with LogReader(path) as reader:
        count = sum(1 for _ in reader.messages())
        originals = sum(1 for _ in reader.originals())
        for _ in reader.provenance():
            pass
        for name in ("riot_bus.graph", "riot_bus.lost", "x"):
            for _ in reader.notes(name):
                pass
        _ = reader.metadata, reader.profile, reader.library, reader.schemas, reader.sources()
        return {"messages": count, "originals": originals, "loss": str(reader.loss), "lossy": bool(reader.loss)}


def select(path: Path) -> None:
    """Read some topics of some time."""
    from riot_bus.log.reader import LogReader

    with LogReader(path) as reader:
        for _ in islice(reader.messages(topics=["/twist", "a/**"], start=10**18 + 3, end=10**18 + 40), 1000):
            pass


def play(path: Path) -> None:
    """Do what `riot play` does before and while it publishes."""
    from riot_bus.log.playback.sources import LogSource, MergedSource
    from riot_bus.log.reader import LogReader

    with LogReader(path) as reader:
        topics = reader.recorded_topics()
        reader.span()
        source = LogSource(reader, {topic.key: f"x/{number}" for number, topic in enumerate(topics)}, shift=5)
        for _ in islice(MergedSource([source, source]).messages(), 3000):
            pass
        for _ in islice(LogSource(reader).messages(start=10**18 + 20), 1000):
            pass


def info(path: Path) -> dict[str, Any]:
    """Say what is in it, from the summary and by reading."""
    from riot_bus.log.info import log_info

    found = log_info(path)
    assert found.scanned
    other = log_info(path, scan=False)
    json.dumps([dataclasses.asdict(found), dataclasses.asdict(other)], default=str)
    return {"messages": found.count, "lossy": bool(found.loss)}


def fields(path: Path) -> None:
    """List the fields and their ranges."""
    from riot_bus.log.reader import LogReader
    from riot_bus.log.tables.ranges import field_ranges

    with LogReader(path) as reader:
        field_ranges(reader)


def types(path: Path) -> None:
    """List the types of its topics."""
    from riot_bus.log.reader import LogReader
    from riot_bus.log.tables.plan import log_registry, topic_types

    with LogReader(path) as reader:
        topic_types(reader, log_registry(reader))


def columns(path: Path) -> dict[str, Any]:
    """Read fields into arrays, whatever their topics are."""
    from riot_bus.log import columns, iter_columns
    from riot_bus.log.reader import LogReader

    with LogReader(path) as reader:
        topics = sorted({source.topic for source in reader.sources().values() if source.role == "delivered"})
    selectors = [f"{topic}:x" for topic in topics[:5] if topic and ":" not in topic]
    found = columns(path, selectors)
    for _ in iter_columns(path, [*selectors, f"{topics[0]}:x where y > 3"], memory=1 << 22, threads=0):
        pass
    return {"rows": {name: len(column) for name, column in found.items()}, "lossy": bool(found.loss)}


def export(path: Path) -> None:
    """Write a table."""
    from riot_bus_logtools.export.export import export_table

    export_table(path, ["/twist:x", "/twist:y"], path.with_suffix(".csv"), force=True)


def edit(path: Path) -> dict[str, Any]:
    """Write what can be read into another log, as it is and changed."""
    from riot_bus_logtools.editing.edit import edit
    from riot_bus_logtools.editing.options import EditOptions

    out = path.with_name(f"edited-{path.name}")
    edit(EditOptions(inputs=[path], output=out, force=True))
    kept = read(out)
    with contextlib.suppress(RiotError):  # there may be no such field
        edit(EditOptions(inputs=[path], output=out, force=True, changes=["/twist:x = 5"], drop=["/string"], sort=True))
        read(out)
    return kept


def salvage(path: Path) -> None:
    """Take what there is of damaged chunks."""
    from riot_bus.log.reader import LogReader
    from riot_bus_logtools.editing.edit import edit
    from riot_bus_logtools.editing.options import EditOptions

    with LogReader(path, salvage=True) as reader:
        for _ in reader.messages():
            pass
    edit(EditOptions(inputs=[path], output=path.with_name(f"salvaged-{path.name}"), force=True, salvage=True))


def diff(path: Path) -> None:
    """Compare it with itself, and with the one before."""
    from riot_bus_logtools.comparison.opening import compare_logs

    former = path.with_name(f"former-{path.name}")
    try:
        for other in (path, *([former] if former.exists() else [])):
            found = compare_logs(other, path)
            json.dumps(found.to_json(), allow_nan=False)
            assert found.same or other != path or not found.comparable
            assert [*found.lines()]
    finally:
        shutil.copyfile(path, former)


def commands(path: Path) -> None:
    """Run the commands as they are typed."""
    command = _command()
    for words in (["info", str(path)], ["info", str(path), "--format", "json"], ["types", str(path)]):
        with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.suppress(RiotError):
            command(words, standalone_mode=False)
        assert "\x1b" not in out.getvalue()
        if words[-1] == "json":
            json.loads(out.getvalue() or "{}")


@cache
def _command() -> Any:
    from typer import Typer
    from typer.main import get_command

    from riot_bus.cli.main import add_commands

    app = Typer()
    add_commands(app, "logs")
    return get_command(app)


ACTIONS: list[Action] = [read, select, play, info, fields, types, columns, export, edit, salvage, diff, commands]
"""Each takes the path of a log and may raise RiotError alone; what it returns is compared by the test."""


def main(folder: Path, first: int, step: int) -> None:
    """Do everything with some of the mutants."""
    import numpy  # noqa: F401 - its memory is none of the actions'
    import rosbags.typesys  # noqa: F401

    from tests.log_mutants import mutants

    faulthandler.enable()
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MOST_MEMORY, used + MOST_MEMORY))

    def too_slow(*_: object) -> None:
        raise TooSlowError

    signal.signal(signal.SIGALRM, too_slow)
    path = folder / f"mutant{first}.mcap"
    for mutant in islice(mutants(), first, None, step):
        path.write_bytes(mutant.data)
        outcome: dict[str, Any] = {"name": mutant.name, "readable": mutant.readable, "lossy": mutant.lossy}
        for action in ACTIONS:
            signal.alarm(MOST_SECONDS)
            try:
                outcome[action.__name__] = action(path)
            except RiotError as error:
                outcome[action.__name__] = {"refused": str(error)}
            except (Exception, TooSlowError, RecursionError) as error:
                where = (
                    "".join(traceback.format_exception(error, limit=-3)) if not isinstance(error, MemoryError) else ""
                )
                outcome.setdefault("wrong", {})[action.__name__] = f"{type(error).__name__}: {where}"
            finally:
                signal.alarm(0)
        print(json.dumps(outcome), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
