"""Filters of links, by message id, source system and source component."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_LARGEST = {"msg_id": (1 << 24) - 1, "src_sys": 255, "src_comp": 255}  # 24, 8 and 8 bits in a frame
_FIELDS = [(action, what) for action in ("allow", "block") for what in _LARGEST]

FILTER_NAMES = {way: frozenset(f"{action}_{what}_{way}" for action, what in _FIELDS) for way in ("in", "out")}
"""Names of the settings: `allow_msg_id_in`, `block_src_sys_out`, ..."""


@dataclass(frozen=True, slots=True)
class Filter:
    """Filter that passes what every non-empty allow list names and no block list names."""

    allow_msg_id: frozenset[int] = frozenset()
    allow_src_sys: frozenset[int] = frozenset()
    allow_src_comp: frozenset[int] = frozenset()
    block_msg_id: frozenset[int] = frozenset()
    block_src_sys: frozenset[int] = frozenset()
    block_src_comp: frozenset[int] = frozenset()

    @property
    def is_open(self) -> bool:
        """Whether everything passes."""
        return not any(getattr(self, f"{action}_{what}") for action, what in _FIELDS)

    def passes(self, message_id: int, system: int, component: int) -> bool:
        """Return whether a message of a source passes."""
        return (
            (not self.allow_msg_id or message_id in self.allow_msg_id)
            and message_id not in self.block_msg_id
            and (not self.allow_src_sys or system in self.allow_src_sys)
            and system not in self.block_src_sys
            and (not self.allow_src_comp or component in self.allow_src_comp)
            and component not in self.block_src_comp
        )


def filter_of(settings: Mapping[str, str], id_of: Callable[[str], int | None], *, where: str = "") -> Filter:
    """Return the filter that settings describe.

    Args:
        settings: Comma-separated numbers or message names, by setting (see `FILTER_NAMES`).
        id_of: Returns the id of a message name, None if unknown.
        where: Place of the settings, for errors.

    Raises:
        ConfigError: A value is neither a number in range nor a known message.
    """
    lists: dict[str, frozenset[int]] = {}
    for key, text in settings.items():
        name = key.rpartition("_")[0]
        what = name.partition("_")[2]
        words = [word.strip() for word in text.split(",") if word.strip()]
        lists[name] = frozenset(_number(word, what, id_of, where=where, key=key) for word in words)
    return Filter(**lists)


def _number(word: str, what: str, id_of: Callable[[str], int | None], *, where: str, key: str) -> int:
    if word.isascii() and word.isdigit() and len(word) < 10:
        if int(word) <= _LARGEST[what]:
            return int(word)
        raise ConfigError(f"{key}: {word} is over {_LARGEST[what]}", where=where)
    found = id_of(word) if what == "msg_id" else None
    if found is None:
        hint = "numbers or names of messages, such as 0 or HEARTBEAT" if what == "msg_id" else "numbers from 1 to 255"
        raise ConfigError(f"{key}: {word!r} is not known", where=where, hint=hint)
    return found
