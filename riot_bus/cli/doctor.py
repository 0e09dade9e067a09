"""`riot doctor` and `riot interceptors`."""

from __future__ import annotations

from typing import Annotated

import typer

from riot_bus.cli.fastpath import warn
from riot_bus.cli.options import Format, OutputFormat
from riot_bus.cli.printing import print_json, print_result
from riot_bus.plugins import hook


def doctor(
    *,
    listen: Annotated[
        list[str] | None, typer.Option(metavar="ENDPOINT", help="Where a router is going to listen; repeatable.")
    ] = None,
    scouting: Annotated[
        bool, typer.Option("--scouting/--no-scouting", help="Ask on this host who answers multicast scouting.")
    ] = True,
    transparency: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="ENDPOINT_A ENDPOINT_B",
            help="Compare a running router, between these two of its segments, with a plain one; takes some minutes.",
        ),
    ] = None,
    acl: Annotated[
        str | None,
        typer.Option(metavar="ENDPOINT", help="Try out who can do what at a fleet's router; takes some seconds."),
    ] = None,
    identity: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME:KEY=VALUE",
            help="A Zenoh setting of an identity that --acl tries; repeatable. One named like a role (agent, "
            "controller, viewer) is compared with what the role needs; one without any settings is tried, too.",
        ),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="For --acl: robot whose keys are tried; its agent must not run. [default: a name that no robot has]",
        ),
    ] = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Check this host for what would spoil a run. Exit code 4: something would."""
    from dataclasses import asdict

    from riot_bus.doctor.checks import check
    from riot_bus.vocabulary.errors import EnvironmentFaultError
    from riot_bus.zenoh.scouting import THIS_HOST

    text = form is OutputFormat.TEXT
    if acl is not None:
        _access(acl, identity or [], robot, form)
        return
    checks = check(endpoints=listen or (), scouting=THIS_HOST if scouting else None)
    for each in checks if text else ():
        typer.echo(f"{each.status:8} {each.name}: {each.text}" + (f"\n         cure: {each.cure}" if each.cure else ""))
    compared = []
    if transparency is not None:
        for verdict in hook("transparency", "riot_bus_conformance")(transparency):
            compared.append(verdict)
            if text:
                typer.echo(str(verdict))
    if not text:
        print_json({"checks": [asdict(each) for each in checks], "transparency": [asdict(each) for each in compared]})
    if any(each.status == "problem" for each in checks) or any(each.differences for each in compared):
        raise typer.Exit(EnvironmentFaultError.exit_code)


def _access(endpoint: str, identities: list[str], robot: str | None, form: OutputFormat) -> None:
    from dataclasses import asdict

    from riot_bus.control.component import client_cfg
    from riot_bus.control.router_options import parse_cfg
    from riot_bus.vocabulary.errors import EnvironmentFaultError

    settings: dict[str, list[str]] = {}
    for each in identities:
        name, key, value = parse_cfg(each, "--identity")
        settings.setdefault(name, []).append(f"{key}={value}")
    configs = {name: client_cfg(texts) for name, texts in settings.items()}
    found = hook("access", "riot_bus_fleet")(endpoint, configs, robot=robot, say=warn)
    excess = [each for each in found if each.needed is False]
    marks = {True: "ok", False: "problem", None: ""}
    lines = [
        f"{marks[each.needed]:8} {each.identity}: {each.action} {each.key} (seen with {', '.join(each.seen_by)})"
        for each in found
    ]
    lines.append(
        f"{len(found)} things were seen; {len(excess)} of them no role needs. What is not listed was not seen."
    )
    print_result(form, [asdict(each) for each in found], lines)
    if excess:
        raise typer.Exit(EnvironmentFaultError.exit_code)


def interceptors(*, form: Format = OutputFormat.TEXT) -> None:
    """List the interceptors that `riot router --interceptor` knows by name, and their options."""
    from riot_bus.interceptors.catalogue import interceptor_list

    found, lines = interceptor_list(), list[str]()
    for each in found:
        lines.append(f"{each['name']}: {each['summary']}")
        for option in each["options"]:
            default = "" if option["default"] is None else f" (default {option['default']})"
            lines.append(f"    {option['name']}: {option['doc'] or option['type']}{default}")
    print_result(form, found, lines)
