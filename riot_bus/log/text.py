"""Human-readable sizes, in the form that `riot record --split-size` accepts."""

from __future__ import annotations

__all__ = ["size_text"]


def size_text(size: float) -> str:
    """Return a size in bytes as human-readable text.

    Example:
        >>> size_text(999), size_text(1500), size_text(2_000_000)
        ('999 B', '1.5 kB', '2.0 MB')
    """
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"
        size /= 1000
    return f"{size:.1f} TB"
