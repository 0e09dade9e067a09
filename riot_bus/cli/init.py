"""`riot init`: write a first riot.toml."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from riot_bus.cli.ctl import Cfg, Endpoint, RouterName
from riot_bus.cli.fastpath import warn
from riot_bus.cli.options import DEFAULT_SYSTEM, Format, OutputFormat
from riot_bus.cli.printing import print_result
from riot_bus.config.arguments import DEFAULT_ENDPOINT

__all__ = ["init"]


def init(
    *,
    ros2: Annotated[
        bool, typer.Option("--ros2", help="Describe the ROS 2 nodes that are connected to a router.")
    ] = False,
    mavlink: Annotated[
        list[str] | None,
        typer.Option(
            "--mavlink", metavar="URL", help="Describe who is heard on a link, such as udpin:0.0.0.0:14550; repeatable."
        ),
    ] = None,
    link: Annotated[
        list[str] | None,
        typer.Option(metavar="ADAPTER=URL", help="Likewise, with any adapter that can listen to links; repeatable."),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(metavar="FILE.mcap", help="Describe what a recording shows, such as one of riot router."),
    ] = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    router: RouterName = None,
    seconds: Annotated[float, typer.Option("--seconds", min=0.1, max=600, help="How long to look, in seconds.")] = 3.0,
    record: Annotated[
        Path | None,
        typer.Option(metavar="FILE.mcap", help="Record what is seen, as the nominal log. Plain Zenoh only."),
    ] = None,
    start: Annotated[
        bool,
        typer.Option(
            "--start",
            help="Then start each component once more, separately from those that run, to see what each reads and "
            "writes. Plain Zenoh only.",
        ),
    ] = False,
    unit: Annotated[
        str | None,
        typer.Option(
            "--unit",
            "-u",
            metavar="NAME",
            help="Component or node to test, else all that have inputs; for MAVLink, the id of the system.",
        ),
    ] = None,
    external: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Component or node that plays the outside world, else all that only publish; repeatable.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The file to write.")] = DEFAULT_SYSTEM,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False,
    cfg: Cfg = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Write a first riot.toml: the components, inputs, outputs and types that are seen, and what is left to fill in.

    Without --ros2, --mavlink or --link it describes a plain Zenoh system: what is connected to a router.
    """
    from riot_bus.vocabulary.errors import ConfigError

    heard = [*(f"mavlink={url}" for url in mavlink or ()), *(link or ())]
    chosen = [name for name, given in (("--ros2", ros2), ("--mavlink or --link", heard), ("--log", log)) if given]
    plain = [name for name, given in (("--record", record), ("--start", start)) if given]
    if len(chosen) > 1 or (chosen and plain):
        raise ConfigError(f"{' and '.join([*chosen, *plain])} do not go together", where="riot init", hint="choose one")
    if heard:
        adapters = {each.partition("=")[0] for each in heard}
        links = [each.partition("=")[2] for each in heard]
        if len(adapters) > 1 or not all(links):
            hint = "write ADAPTER=URL, such as mavlink=udpin:0.0.0.0:14550, with one adapter for all links"
            raise ConfigError(f"cannot listen to {', '.join(heard)}", where="riot init --link", hint=hint)
        _init_links(adapters.pop(), links, out, seconds=seconds, unit=unit, force=force, form=form)
        return
    what: dict[str, Any] = {"unit": unit, "external": external or (), "force": force}
    live: dict[str, Any] = {"seconds": seconds, "cfg": cfg or (), **what}
    if ros2:
        from riot_bus.sut.init import init_ros2

        found, lines = init_ros2(out, endpoint, **live), _lines
    else:
        from riot_bus.sut.init import init_plain, init_plain_log

        lines = _plain_lines
        if log is not None:
            found = init_plain_log(out, log, **what)
        else:
            found = init_plain(out, endpoint, record=record, start=start, router=router, **live)
    print_result(form, found, lines(found))


def _init_links(
    adapter: str, links: list[str], out: Path, *, seconds: float, unit: str | None, force: bool, form: OutputFormat
) -> None:
    from riot_bus.sut.init import init_links

    found = init_links(out, adapter, links, seconds=seconds, unit=unit, force=force, warn=warn)
    print_result(form, {"file": str(out), **found.facts}, [*found.lines, _written(str(out))])


def _written(file: str) -> str:
    return f"written: {file}; next, fill in what it marks with FILL IN, above all the commands"


def _plain_lines(found: dict[str, Any]) -> list[str]:
    from riot_bus.sut.scaffold import draft_lines

    return [*draft_lines(found), f"written: {found['file']}"]


def _lines(found: dict[str, Any]) -> list[str]:
    parts = found["components"]
    width = max(len(part["name"]) for part in parts)
    lines = [
        f"{part['name']:{width}}  {part['segment']:7}  {len(part['inputs'])} in, {len(part['outputs'])} out"
        for part in parts
    ]
    external = ", ".join(found["external"]) or "none found"
    lines.append(f"external topics: {external}")
    if found["unknown_types"]:
        lines.append(f"types without a definition here: {', '.join(found['unknown_types'])}")
    if found["skipped"]:
        lines.append(f"{found['skipped']} announcements were too many to look at")
    return [*lines, _written(found["file"])]
