"""Keys of frames on the bus: `mavlink_raw/{link}/{sysid}/{compid}/{MESSAGE}`, or as the user wants them."""

from __future__ import annotations

import re
from typing import NamedTuple

from riot_bus.vocabulary.errors import ConfigError

TEMPLATE = "mavlink_raw/{link}/{sysid}/{compid}/{MESSAGE}"

_PARTS = {
    "link": r"(?P<link>[^/*$?#]+)",
    "sysid": r"(?P<sysid>[0-9]{1,3})",
    "compid": r"(?P<compid>[0-9]{1,3})",
    "MESSAGE": r"(?P<MESSAGE>[A-Za-z_][A-Za-z0-9_]*)",
}
_PLACEHOLDER = re.compile(r"\{([^{}]*)\}")
_LITERAL = re.compile(r"[^{}*$?#/]+")
_HINT = f"write it like {TEMPLATE!r}"


class Parsed(NamedTuple):
    """The parts of a key; those that the template lacks are empty, or None."""

    link: str
    system: int | None
    component: int | None
    message: str


class KeyTemplate:
    """Template that forms keys from links, senders and messages, and parses them.

    Args:
        text: Chunks, each a placeholder ({link}, {sysid}, {compid}, {MESSAGE}) or literal; {MESSAGE} is needed.

    Raises:
        ConfigError: The text is not a valid template.
    """

    def __init__(self, text: str = TEMPLATE) -> None:
        self.text = text
        self._chunks = text.split("/")
        pattern, seen = [], []
        for chunk in self._chunks:
            placeholder = _PLACEHOLDER.fullmatch(chunk)
            if placeholder is not None and placeholder[1] in _PARTS and placeholder[1] not in seen:
                seen.append(placeholder[1])
                pattern.append(_PARTS[placeholder[1]])
            elif _LITERAL.fullmatch(chunk):
                pattern.append(re.escape(chunk))
            else:
                raise ConfigError(f"{chunk!r} in the template of keys {text!r} is not understood", hint=_HINT)
        if "MESSAGE" not in seen or len(seen) == len(self._chunks):
            raise ConfigError(f"the template of keys {text!r} needs {{MESSAGE}} and a word of its own", hint=_HINT)
        self._pattern = re.compile("/".join(pattern))

    def key(self, link: str, system: int, component: int, message: str) -> str:
        """Return the key of a frame."""
        return self.expression(link, str(system), str(component), message)

    def expression(self, link: str = "*", system: str = "*", component: str = "*", message: str = "*") -> str:
        """Return a key expression for some frames; by default for all."""
        parts = {"{link}": link, "{sysid}": system, "{compid}": component, "{MESSAGE}": message}
        return "/".join(parts.get(chunk, chunk) for chunk in self._chunks)

    def parse(self, key: str) -> Parsed | None:
        """Return the parts of a key, None if it does not match the template."""
        match = self._pattern.fullmatch(key)
        if match is None:
            return None
        found = match.groupdict()
        system, component = (None if text is None else int(text) for text in map(found.get, ("sysid", "compid")))
        if (system or 0) > 255 or (component or 0) > 255:
            return None
        return Parsed(found.get("link") or "", system, component, found["MESSAGE"])
