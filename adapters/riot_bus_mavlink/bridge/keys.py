"""Keys of frames on the bus, by a template."""

from __future__ import annotations

import re

from riot_bus.errors import ConfigError

__all__ = ["DEFAULT_TEMPLATE", "Keys"]

DEFAULT_TEMPLATE = "mavlink_raw/{link}/{sysid}/{compid}/{message}"
"""Link, system, component and name of the message."""

_PARTS = ("link", "sysid", "compid", "message")
_CHUNK = re.compile(r"\{(link|sysid|compid|message)\}|[A-Za-z0-9_.~@%+-]+")


class Keys:
    """Makes keys.

    Args:
        template: Chunks separated by `/`; `{link}`, `{sysid}`, `{compid}` and `{message}` are chunks of their own. All
            but `{link}` have to be there, once.

    Raises:
        ConfigError: It is no such template.
    """

    def __init__(self, template: str = DEFAULT_TEMPLATE) -> None:
        chunks = template.split("/")
        wrong = next((chunk for chunk in chunks if _CHUNK.fullmatch(chunk) is None), None)
        if wrong is not None:
            hint = f"such as {DEFAULT_TEMPLATE}"
            raise ConfigError(f"{wrong!r} in {template!r} cannot be a part of a key", where="--keys", hint=hint)
        for part in _PARTS:
            count = chunks.count("{" + part + "}")
            if count > 1 or (not count and part != "link"):
                word = "is there twice" if count else "is missing"
                raise ConfigError(f"{{{part}}} {word} in {template!r}", where="--keys", hint=f"as {DEFAULT_TEMPLATE}")
        self.template = template
        self.expression = "/".join("*" if chunk.startswith("{") else chunk for chunk in chunks)

    def key(self, link: str, system: int, component: int, message: str) -> str:
        """Return the key of a frame."""
        return self.template.format(link=link, sysid=system, compid=component, message=message)
