"""Options of `riot init`, declared once; light, since the help of all commands is made from them, too."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from riot_bus.config.arguments import DEFAULT_ENDPOINT
from riot_bus.vocabulary.flags import Flag


@dataclass(frozen=True, slots=True, kw_only=True)
class InitOptions:
    """How `riot init` looks at a system, and the system file that it writes."""

    endpoint: str = DEFAULT_ENDPOINT
    config: Mapping[str, Any] = field(default_factory=dict)
    router: str | None = None
    seconds: Annotated[float, Flag("How long to look, in seconds.", least=0.1, most=600)] = 3.0
    record: Annotated[
        Path | None, Flag("Record what is seen, as the nominal log. Plain Zenoh only.", metavar="FILE.mcap")
    ] = None
    start: Annotated[
        bool,
        Flag(
            "Then start each component once more, separately from those that run, to see what each reads and writes. "
            "Plain Zenoh only."
        ),
    ] = False
    unit: Annotated[
        str | None,
        Flag(
            "Component or node to test, else all that have inputs; for MAVLink, the id of the system.",
            "--unit -u",
            "NAME",
        ),
    ] = None
    external: Annotated[
        Sequence[str],
        Flag("Component or node that plays the outside world, else all that only publish; repeatable.", metavar="NAME"),
    ] = ()
    out: Annotated[Path, Flag("The file to write.", "--out -o", "FILE")] = Path("riot.toml")
    force: Annotated[bool, Flag("Replace a file that is there.")] = False
