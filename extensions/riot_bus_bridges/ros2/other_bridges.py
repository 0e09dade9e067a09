"""Discovery of other bridges: each declares a token on its segment, and each is a node in its domain."""

from __future__ import annotations

import re
from typing import NamedTuple

_DOMAIN = re.compile("[0-9]{1,3}")


class OtherBridge(NamedTuple):
    """Another bridge, as described by its token."""

    domain: int
    zid: str
    name: str

    def token(self) -> str:
        """Return the last chunks of its token."""
        return f"{self.domain}/{self.zid}/{self.name}"

    @classmethod
    def parse(cls, token: str) -> OtherBridge | None:
        """Parse a token; return None if it is not the token of a bridge."""
        chunks = token.split("/")[-3:]  # domain, id of the session and name, see `token`
        if len(chunks) < 3 or not _DOMAIN.fullmatch(chunks[0]):
            return None
        return cls(int(chunks[0]), chunks[1], chunks[2])
