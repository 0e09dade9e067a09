"""Text that a bridge prints at its start and at its end."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.text_table import table_lines

if TYPE_CHECKING:
    from collections.abc import Mapping


def ready_line(status: Mapping[str, Any]) -> str:
    """Return a line that says which links are in which segment."""
    parts = []
    for name, segment in status["segments"].items():
        links = [
            f"{link} ({each['kind']} {each['where']})"
            for link, each in status["links"].items()
            if each["segment"] == name
        ]
        parts.append(f"{', '.join(links) or 'nothing'} and {name or 'the segment'} ({segment['endpoint']})")
    return f"ready: {'; '.join(parts)}"


def summary_lines(status: Mapping[str, Any]) -> list[str]:
    """Return lines with notes and a table of what crossed and what was lost before it arrived."""
    rows = [("", "in", "out", "lost before", "not sent", "bad checksum", "junk bytes")]
    notes = []
    for name, link in status["links"].items():
        lost = sum(each["lost"] for each in link["sources"].values())
        numbers = (
            *(link.get(what, 0) for what in ("in", "out")),
            lost,
            *(link.get(what, 0) for what in ("lost_out", "bad_crc", "junk_bytes")),
        )
        rows.append((name, *map(str, numbers)))
        if link["dropped_packets"]:
            notes.append(f"{name}: {link['dropped_packets']} packets came faster than they were taken, and were lost")
        notes += [
            f"{name}: {link[what]} {text}"
            for what, text in (
                ("duplicate", "duplicates were dropped"),
                ("filtered_in", "frames were filtered as they came"),
                ("filtered_out", "frames were filtered before they went"),
                ("unknown", "frames of unknown messages"),
            )
            if link.get(what)
        ]
    for name, segment in status["segments"].items():
        to, back = segment.get("to_bus", 0), segment.get("from_bus", 0)
        text = f"{name or 'segment'}: {to} frames to the bus, {back} from it"
        words = ("lost_to_bus", "inserted", "broken", "refused", "unrouted")
        extra = [f"{segment[word]} {word}" for word in words if segment.get(word)]
        notes.append(f"{text} ({', '.join(extra)})" if extra else text)
    return [*notes, *table_lines(rows)]
