"""Options of `riot bridge mavlink`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.flags import Flag
from riot_bus_mavlink.keys import TEMPLATE, KeyTemplate

if TYPE_CHECKING:
    from riot_bus_bridges.mavlink.url import LinkSpec
    from riot_bus_mavlink.dialect import Dialect
    from riot_bus_mavlink.signing import Signer

_LONGEST_PERIOD_S = 60.0  # a guess: sources of over 4 frames/s repeat sequence numbers within it


@dataclass(frozen=True, slots=True)
class MavlinkBridgeOptions:
    """What to bridge, as the user wrote it: options of `riot bridge mavlink`, declared here alone.

    Attributes:
        patient: Whether to listen to a segment only once a peer is connected to one of its links, so that nothing is
            sent to a program that is not connected yet.
    """

    links: Annotated[
        Sequence[str],
        Flag(
            "A link: udpin:0.0.0.0:14550, udpout:HOST:PORT, tcpin:0.0.0.0:5760, tcp:HOST:PORT, /dev/ttyACM0,115200, "
            "or a .tlog file; repeatable.",
            "--link -l",
            "[SEGMENT[/NAME]=]URL",
        ),
    ] = ()
    dialect: Annotated[
        str | None, Flag("MAVLink dialect, of those that pymavlink ships. [default: all]", metavar="NAME")
    ] = None
    files: Annotated[Sequence[Path], Flag("XML file that defines more messages; repeatable.", "--xml", "FILE")] = ()
    keys: Annotated[str, Flag("Template of the keys on the bus.", metavar="TEMPLATE")] = TEMPLATE
    duplicates: Annotated[
        float, Flag("Drop a frame that came within this time before, over any link; 0: drop none.", metavar="SECONDS")
    ] = 0.0
    key_file: Annotated[
        Path | None,
        Flag("File with the key to re-sign signed frames that come late or are renumbered.", metavar="FILE"),
    ] = None
    sniffer: Annotated[int, Flag("System that gets all frames; 0: none.", metavar="SYSID")] = 0
    mirror: Annotated[
        Literal["messages", "fields"] | None,
        Flag(
            "Also publish frames as JSON on mavlink/..., with fields each field, and take such, as mavlink-server does."
        ),
    ] = None
    patient: bool = False

    def adapters(self) -> list[str]:
        """Return the router option for an adapter with the same keys and types; empty if the default one has them."""
        usual = {"dialect": None, "template": TEMPLATE, "key_file": None}
        chosen = {"dialect": self.dialect, "template": self.keys, "key_file": self.key_file}
        texts = [f"{name}={value}" for name, value in chosen.items() if value != usual[name]]
        return [f"mavlink:{';'.join(texts)}"] if texts else []

    def plan(self, segments: Sequence[str]) -> "MavlinkBridgePlan":
        """Return what is to be bridged; raises ConfigError, or MissingExtraError if pymavlink is missing."""
        from riot_bus_bridges.mavlink.url import parse_links
        from riot_bus_mavlink.dialect import DEFAULT, load_dialect
        from riot_bus_mavlink.signing import Signer, read_key

        if not self.links:
            hint = "such as --link udpin:0.0.0.0:14550"
            raise ConfigError("there is no link to be bridged", where="--link", hint=hint)
        if not 0 <= self.duplicates <= _LONGEST_PERIOD_S:
            hint = f"0 to {_LONGEST_PERIOD_S:g} s; less than the period of the fastest message that never changes"
            raise ConfigError(f"{self.duplicates:g} s is not a usable period", where="--duplicates", hint=hint)
        if not 0 <= self.sniffer <= 255:
            raise ConfigError(f"{self.sniffer} is not the id of a system", where="--sniffer", hint="1 to 255")
        dialect = load_dialect(self.dialect or DEFAULT, self.files)
        links = parse_links(self.links, id_of=dialect.id_of, segments=segments)
        signer = None if self.key_file is None else Signer(read_key(self.key_file))
        return MavlinkBridgePlan(dialect, KeyTemplate(self.keys), links, signer)


@dataclass(frozen=True, slots=True)
class MavlinkBridgePlan:
    """Plan of a bridge, made from its options."""

    dialect: "Dialect"
    keys: KeyTemplate
    links: "Sequence[LinkSpec]"
    signer: "Signer | None" = None
