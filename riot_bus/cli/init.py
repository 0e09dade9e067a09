"""`riot init`: write a first riot.toml."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from riot_bus.cli.ctl import Cfg, Endpoint, RouterName
from riot_bus.cli.declared import declared
from riot_bus.cli.fastpath import warn
from riot_bus.cli.options import Format, OutputFormat
from riot_bus.cli.printing import print_result
from riot_bus.config.arguments import DEFAULT_ENDPOINT
from riot_bus.draft.init_options import InitOptions


@declared(InitOptions, before="cfg")
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
    cfg: Cfg = None,
    form: Format = OutputFormat.TEXT,
    **given: Any,
) -> None:
    """Write a first riot.toml: the components, inputs, outputs and types that are seen, and what is left to fill in.

    Without --ros2, --mavlink or --link it describes a plain Zenoh system: what is connected to a router.
    """
    from riot_bus.draft.init import init_links, init_log, init_network, init_nodes
    from riot_bus.draft.writing import draft_lines, written_line
    from riot_bus.vocabulary.errors import ConfigError

    config: dict[str, Any] = {}
    if cfg:  # a log, or links, are looked at without the live half of riot
        from riot_bus.control.component import client_cfg

        config = client_cfg(cfg)
    options = InitOptions(endpoint=endpoint, router=router, config=config, **given)
    heard = [*(f"mavlink={url}" for url in mavlink or ()), *(link or ())]
    listening = "--mavlink" if mavlink else "--link"
    chosen = [name for name, given in (("--ros2", ros2), (listening, heard), ("--log", log)) if given]
    plain = [name for name, given in (("--record", options.record), ("--start", options.start)) if given]
    if len(chosen) > 1 or (chosen and plain):
        hint = "choose one" if len(chosen) > 1 else "only a plain Zenoh system that runs can be recorded or started"
        raise ConfigError(f"{' and '.join([*chosen, *plain])} do not go together", where="riot init", hint=hint)
    if heard:
        adapters = {each.partition("=")[0] for each in heard}
        links = [each.partition("=")[2] for each in heard]
        if len(adapters) > 1 or not all(links):
            hint = "write ADAPTER=URL, such as mavlink=udpin:0.0.0.0:14550, with one adapter for all links"
            raise ConfigError(f"cannot listen to {', '.join(heard)}", where="riot init --link", hint=hint)
        system, file = init_links(options, adapters.pop(), links, warn=warn), str(options.out)
        print_result(form, {"file": file, **system.facts}, [*system.lines, written_line(file)])
        return
    found = init_log(options, log) if log is not None else init_nodes(options) if ros2 else init_network(options)
    print_result(form, found, draft_lines(found))
