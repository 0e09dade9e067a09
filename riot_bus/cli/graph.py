"""`riot graph`: who talks to whom, as a running router sees it."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from riot_bus.cli.ctl import Cfg, Endpoint, RouterName
from riot_bus.config.arguments import DEFAULT_ENDPOINT


class GraphFormat(StrEnum):
    """How a graph is written to stdout."""

    TEXT = "text"
    JSON = "json"
    MERMAID = "mermaid"
    DOT = "dot"


def graph(
    *,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    router: RouterName = None,
    cfg: Cfg = None,
    form: Annotated[
        GraphFormat, typer.Option("--format", envvar="RIOT_FORMAT", help="Form of the result on stdout.")
    ] = GraphFormat.TEXT,
    watch: Annotated[bool, typer.Option("--watch", "-w", help="Print each change until Ctrl-C.")] = False,
) -> None:
    """Show who talks to whom in the segments of a running router, and what is not known."""
    from riot_bus.control.component import client_cfg
    from riot_bus.control.remote import Remote, graphs
    from riot_bus.graph.render import render

    with Remote(endpoint, router, config=client_cfg(cfg or ())) as remote:
        for found in graphs(remote, watch=watch):
            typer.echo(render(found, form.value, indent=None if watch else 1).rstrip("\n"))
