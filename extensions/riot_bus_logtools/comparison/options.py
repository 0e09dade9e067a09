"""The part of logs that is compared: options of `riot diff`, declared once; light, since help is made from them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from riot_bus.vocabulary.flags import Definitions, Flag, Salvage, Types


@dataclass(frozen=True, slots=True, kw_only=True)
class Extract:
    """The part of the logs that is compared; by default all of them."""

    topics: Annotated[Sequence[str], Flag("Compare these: names or key expressions; repeatable.", metavar="TOPIC")] = ()
    exclude: Annotated[Sequence[str], Flag("Leave these out: likewise; repeatable.", metavar="TOPIC")] = ()
    start: Annotated[
        str | None, Flag("Begin there: seconds from each log's beginning, or a date and time.", metavar="TIME")
    ] = None
    end: Annotated[str | None, Flag("End there, likewise; exclusive.", metavar="TIME")] = None
    salvage: Salvage = False
    types: Types = ()
    definitions: Definitions = ()
