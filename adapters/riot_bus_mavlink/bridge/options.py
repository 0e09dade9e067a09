"""Options of `riot bridge mavlink`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_mavlink.bridge.url import parse_links
from riot_bus_mavlink.dialect import DEFAULT, load_dialect
from riot_bus_mavlink.keys import TEMPLATE, KeyTemplate
from riot_bus_mavlink.signing import Signer, read_key

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from riot_bus_mavlink.bridge.url import LinkSpec
    from riot_bus_mavlink.dialect import Dialect

__all__ = ["MavlinkBridgeOptions", "MavlinkBridgePlan"]

_LONGEST_PERIOD_S = 60.0  # a guess: sources of over 4 frames/s repeat sequence numbers within it


@dataclass(frozen=True, slots=True)
class MavlinkBridgeOptions:
    """What to bridge, as the user wrote it.

    Attributes:
        links: Links in the form that `parse_link` takes.
        dialect: Name of a dialect that pymavlink ships.
        files: XML files of further messages.
        keys: Template of the keys of frames on the bus.
        duplicates: Seconds within which a repeated frame is dropped; 0 to drop none.
        sniffer: Id of a system that gets everything; 0 for none.
        key_file: File with the key of signed frames.
        mirror: Parts that are also published as JSON, as by mavlink-server: `messages`; with `fields`, each field, too.
        patient: Whether to listen to a segment only once a peer is connected to one of its links, so that nothing is
            sent to a program that is not connected yet.
    """

    links: Sequence[str]
    dialect: str = DEFAULT
    files: Sequence[Path] = field(default_factory=tuple)
    keys: str = TEMPLATE
    duplicates: float = 0.0
    sniffer: int = 0
    key_file: Path | None = None
    mirror: Literal["messages", "fields"] | None = None
    patient: bool = False

    def adapters(self) -> list[str]:
        """Return the router option for an adapter with the same keys and types; empty if the default one has them."""
        usual = {"dialect": DEFAULT, "template": TEMPLATE, "key_file": "None"}
        chosen = {"dialect": self.dialect, "template": self.keys, "key_file": str(self.key_file)}
        texts = [f"{name}={value}" for name, value in chosen.items() if value != usual[name]]
        return [f"mavlink:{';'.join(texts)}"] if texts else []

    def plan(self, segments: Sequence[str]) -> MavlinkBridgePlan:
        """Return what is to be bridged.

        Args:
            segments: Names of the segments.

        Raises:
            ConfigError: An option is not usable.
            MissingExtraError: pymavlink is not installed.
        """
        if not self.links:
            hint = "such as --link udpin:0.0.0.0:14550"
            raise ConfigError("there is no link to be bridged", where="--link", hint=hint)
        if not 0 <= self.duplicates <= _LONGEST_PERIOD_S:
            hint = f"0 to {_LONGEST_PERIOD_S:g} s; less than the period of the fastest message that never changes"
            raise ConfigError(f"{self.duplicates:g} s is not a usable period", where="--duplicates", hint=hint)
        if not 0 <= self.sniffer <= 255:
            raise ConfigError(f"{self.sniffer} is not the id of a system", where="--sniffer", hint="1 to 255")
        dialect = load_dialect(self.dialect, self.files)
        links = parse_links(self.links, id_of=dialect.id_of, segments=segments)
        signer = None if self.key_file is None else Signer(read_key(self.key_file))
        return MavlinkBridgePlan(dialect, KeyTemplate(self.keys), links, signer)


@dataclass(frozen=True, slots=True)
class MavlinkBridgePlan:
    """Plan of a bridge, made from its options.

    Attributes:
        dialect: Dialect with the known messages.
        keys: Template of the keys of frames on the bus.
        links: The links to be opened.
        signer: Signer with the key of signed frames, None if no key was given.
    """

    dialect: Dialect
    keys: KeyTemplate
    links: Sequence[LinkSpec]
    signer: Signer | None = None
