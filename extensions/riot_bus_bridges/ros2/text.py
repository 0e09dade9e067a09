"""Text that a bridge prints at its end."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.text_table import table_lines

if TYPE_CHECKING:
    from collections.abc import Mapping


def summary_lines(status: Mapping[str, Any]) -> list[str]:
    """Return a table of what crossed."""
    topics, services, refused = status["topics"], status["services"], status["refused"]
    if not topics and not services:
        return ["there was nothing to bridge"]
    rows = [("", "to segment", "to domain")]
    rows += [(name, str(ways["to_segment"]), str(ways["to_domain"])) for name, ways in topics.items()]
    rows += [(name, f"{count} calls", "") for name, count in services.items()]
    return [
        *(f"{name}: {count} messages of the domain were lost" for name, count in status["lost"].items()),
        *(f"{name}: {count} messages too short to be valid were left out" for name, count in refused.items()),
        *table_lines(rows),
    ]
