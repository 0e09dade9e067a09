"""Tools for logs: edit, compare, export, import. For scripts: `edit(EditOptions(...))`."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from riot_bus_logtools.editing.edit import edit as edit
    from riot_bus_logtools.editing.options import EditOptions as EditOptions


def __getattr__(name: str) -> Any:
    if name not in ("EditOptions", "edit"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from riot_bus_logtools.editing import edit, options

    return edit.edit if name == "edit" else options.EditOptions
