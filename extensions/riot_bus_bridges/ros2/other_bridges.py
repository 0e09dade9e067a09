"""Discovery of other bridges: each declares a token on its segment, and each is a node in its domain."""

from __future__ import annotations

import re
from typing import NamedTuple

_CHUNKS = 3  # domain, id of the session and name, see `token`
_DOMAIN = re.compile("[0-9]{1,3}")


class OtherBridge(NamedTuple):
    """Another bridge, as described by its token.

    Attributes:
        domain: `ROS_DOMAIN_ID` of its domain.
        zid: Id of its Zenoh session.
        name: Name of its node in the domain.
    """

    domain: int
    zid: str
    name: str

    def token(self) -> str:
        """Return the last chunks of its token."""
        return f"{self.domain}/{self.zid}/{self.name}"

    @classmethod
    def parse(cls, token: str) -> OtherBridge | None:
        """Parse a token; return None if it is not the token of a bridge."""
        chunks = token.split("/")[-_CHUNKS:]
        if len(chunks) < _CHUNKS or not _DOMAIN.fullmatch(chunks[0]):
            return None
        return cls(int(chunks[0]), chunks[1], chunks[2])
