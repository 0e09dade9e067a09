"""The environment that renders pages from templates."""

from __future__ import annotations

import base64
import hashlib
import platform
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import riot_bus
from riot_bus.report import format as words
from riot_bus.vocabulary.errors import needs_extra

if TYPE_CHECKING:
    from jinja2 import Environment

_TEMPLATES = Path(__file__).parent / "templates"


def rendered(template: str, **context: Any) -> str:
    """Return the page of a template with the values that it names."""
    return page_environment().get_template(template).render(context)


def page_environment() -> Environment:
    """Return the environment for templates: one style, untrusted texts escaped and cut, no network."""
    with needs_extra("jinja2", "report"):
        from jinja2 import Environment, FileSystemLoader, StrictUndefined
        from markupsafe import Markup
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_finalize,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "interval": lambda one: words.share_interval(one.low, one.high),
        "link": _link,
        "number": words.number,
        "plural": words.plural,
        "seconds": words.seconds,
        "share": words.share,
        "short": lambda text, limit=200: words.clean(str(text), limit=limit),
        "value": words.value,
    }
    css = (_TEMPLATES / "report.css").read_text(encoding="utf-8")
    environment.globals |= {
        "css": Markup(css),  # noqa: S704 - our own file
        "digest": base64.b64encode(hashlib.sha256(css.encode()).digest()).decode("ascii"),
        "versions": f"riot-bus {riot_bus.__version__}, Python {platform.python_version()}, {platform.system()}",
    }
    return environment


def _finalize(what: Any) -> Any:
    """Escape and bound each printed text, whichever record it comes from; excerpts of files have up to 6000 bytes."""
    from markupsafe import Markup

    untrusted = isinstance(what, str) and not isinstance(what, Markup)
    return words.clean(what, limit=20_000, lines=True) if untrusted else what


def _link(name: str) -> str | None:
    """Return a reference to a file below the page, or nothing if the name leads elsewhere."""
    path = PurePosixPath(name)
    if not name or path.is_absolute() or ".." in path.parts or len(name) > 500:
        return None
    return "./" + quote(str(path), errors="replace")
