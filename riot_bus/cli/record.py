"""`riot record`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from riot_bus.cli.ctl import DEFAULT_ENDPOINT, Cfg, Endpoint
from riot_bus.cli.options import Format, OutputFormat

__all__ = ["register"]

_SECRET = ("--cfg", "--fleet-cfg")


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    app.command()(record)


def record(
    keys: Annotated[
        list[str] | None, typer.Argument(metavar="[KEYEXPR...]", help="Key expressions, or ROS names such as /odom.")
    ] = None,
    *,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    cfg: Cfg = None,
    all_: Annotated[bool, typer.Option("--all", "-a", help="Record everything, as without any KEYEXPR.")] = False,
    exclude: Annotated[
        list[str] | None, typer.Option(metavar="TOPIC", help="Leave these out: names or key expressions; repeatable.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE.mcap", help="File to write. [default: named by date and time]"),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file if it exists.")] = False,
    bag: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write a ROS 2 bag: a folder with metadata.yaml; ROS topics only."),
    ] = None,
    compression: Annotated[str, typer.Option(metavar="zstd|lz4|none", help="Compression of chunks.")] = "zstd",
    chunk_size: Annotated[
        str, typer.Option(metavar="SIZE", help="Write a chunk at this size; a crash costs at most one chunk.")
    ] = "1MiB",
    chunk_duration: Annotated[
        str, typer.Option(metavar="TIME", help="Write a chunk at this age, even if it is smaller.")
    ] = "1s",
    durable: Annotated[
        bool, typer.Option("--durable/--no-durable", help="Make sure that the file survives a power failure.")
    ] = True,
    queue_size: Annotated[
        str, typer.Option(metavar="SIZE", help="Memory for messages that wait for a slow disk.")
    ] = "256MiB",
    split_size: Annotated[
        str | None, typer.Option(metavar="SIZE", help="Begin another file at this size, such as 1GB.")
    ] = None,
    split_duration: Annotated[
        str | None, typer.Option(metavar="TIME", help="Begin another file after this time, such as 10min.")
    ] = None,
    max_files: Annotated[
        int, typer.Option(min=0, help="Keep only this many files of this recording, the newest; 0: all.")
    ] = 0,
    ring: Annotated[
        str | None, typer.Option(metavar="TIME", help="Keep only the last TIME, in memory; write it only when told.")
    ] = None,
    ring_size: Annotated[str, typer.Option(metavar="SIZE", help="Maximum memory for the ring.")] = "256MiB",
    dump_on: Annotated[
        list[str] | None,
        typer.Option(
            metavar="'TOPIC where PREDICATE'", help="Write the ring when a message meets this condition; repeatable."
        ),
    ] = None,
    monitors: Annotated[
        Path | None,
        typer.Option(metavar="riot.toml", help="Write the ring when one of the [[monitors]] of this file is violated."),
    ] = None,
    dump_after: Annotated[
        str, typer.Option(metavar="TIME", help="Wait this long before writing the ring, to include what follows.")
    ] = "0s",
    start_paused: Annotated[bool, typer.Option("--start-paused", "-p", help="Begin paused.")] = False,
    throttle: Annotated[
        list[str] | None,
        typer.Option(metavar="TOPIC=HZ", help="Record at most this many messages per second; repeatable."),
    ] = None,
    duration: Annotated[str | None, typer.Option(metavar="TIME", help="End after this time.")] = None,
    latched: Annotated[
        bool, typer.Option("--latched/--no-latched", help="Fetch what publishers keep for late joiners.")
    ] = True,
    graph: Annotated[bool, typer.Option("--graph/--no-graph", help="Write down who talks to whom.")] = True,
    profile: Annotated[
        str | None, typer.Option(metavar="ros2|none", help="MCAP profile. [default: ros2 if there are ROS nodes]")
    ] = None,
    robot: Annotated[str, typer.Option(envvar="RIOT_ROBOT", help="The robot's name, for the log.")] = "",
    note: Annotated[
        list[str] | None, typer.Option(metavar="KEY=TEXT", help="Something else for the log; repeatable.")
    ] = None,
    type_: Annotated[
        list[str] | None, typer.Option("--type", metavar="TOPIC=TYPE", help="Type of a topic's messages.")
    ] = None,
    msg: Annotated[list[Path] | None, typer.Option(metavar="FILE", help="Definitions of message types.")] = None,
    seed: Annotated[int, typer.Option(envvar="RIOT_SEED", help="Seed of the run, for the log.")] = 0,
    name: Annotated[str, typer.Option(envvar="RIOT_RECORDER", help="Name for riot ctl record.")] = "recorder",
    control: Annotated[bool, typer.Option("--control/--no-control", help="Obey riot ctl record.")] = True,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Record a Zenoh network as MCAP: everything, or what is named; until Ctrl-C.

    On a terminal, keys pause and begin another file. SIGUSR1 writes the ring. Exit code 3: messages are lost; how many
    of each topic and why is said at the end and written into the log. 4: nobody answers at the endpoint.
    """
    from riot_bus.cli.terminal import Terminal
    from riot_bus.config.arguments import parse_seconds, parse_size
    from riot_bus.control.component import client_cfg
    from riot_bus.record.options import CaptureOptions
    from riot_bus.record.running import run_capture
    from riot_bus.sut.context import invariants_of
    from riot_bus.vocabulary.errors import ConfigError

    if bag is not None and output is not None:
        raise ConfigError("--bag and --output both say where to", hint="choose one")
    if all_ and keys:
        raise ConfigError("--all and key expressions both say what to record", hint="choose one, or take --exclude")
    options = CaptureOptions(
        endpoint=endpoint,
        config=client_cfg(cfg or ()),
        name=name,
        keys=keys or ("**",),
        exclude=exclude or (),
        output=output if bag is None else bag,
        overwrite=overwrite,
        bag=bag is not None,
        profile="" if profile == "none" else profile,
        compression=compression,
        chunk_bytes=parse_size(chunk_size, "--chunk-size"),
        chunk_seconds=parse_seconds(chunk_duration, "--chunk-duration"),
        durable=durable,
        queue_bytes=parse_size(queue_size, "--queue-size"),
        split_bytes=parse_size(split_size, "--split-size") if split_size else 0,
        split_seconds=parse_seconds(split_duration, "--split-duration") if split_duration else 0.0,
        max_files=max_files,
        ring_seconds=parse_seconds(ring, "--ring") if ring else 0.0,
        ring_bytes=parse_size(ring_size, "--ring-size"),
        dump_on=dump_on or (),
        monitors=invariants_of(monitors) if monitors is not None else (),
        dump_after=parse_seconds(dump_after, "--dump-after"),
        paused=start_paused,
        throttle=throttle or (),
        duration=parse_seconds(duration, "--duration") if duration else 0.0,
        latched=latched,
        graph=graph,
        types=type_ or (),
        definitions=msg or (),
        seed=seed,
        robot=robot,
        notes={**_notes(note or ()), "command": _command(sys.argv)},
        control=control,
    )
    run_capture(
        options,
        say=typer.echo,
        warn=lambda line: typer.echo(line, err=True),
        console=Terminal() if Terminal.present() else None,
        as_json=form is OutputFormat.JSON,
    )


def _notes(texts: list[str] | tuple[()]) -> dict[str, str]:
    from riot_bus.vocabulary.errors import ConfigError

    found = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not key or not equals:
            raise ConfigError(f"{text!r} is no note", where="--note", hint="write KEY=TEXT, such as place='hall 3'")
        found[key] = value
    return found


def _command(words: list[str]) -> str:
    """Return the command line without the values of --cfg, which may be passwords, and configurations of endpoints."""
    import shlex

    from riot_bus.vocabulary.redaction import redacted

    shown, hide = [], False
    for word in words:
        option, equals, value = word.partition("=")
        if hide:
            shown.append(word.partition("=")[0] + "=...")
        elif option in _SECRET and equals:
            shown.append(f"{option}={value.partition('=')[0]}=...")
        else:
            shown.append(redacted(word))
        hide = word in _SECRET
    return shlex.join(["riot", *shown[1:]])
