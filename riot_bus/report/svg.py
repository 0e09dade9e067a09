"""Conversion of Matplotlib's SVG for use inside a page: no styles, no metadata, colours of the page.

Style attributes become presentation attributes, which a content security policy without inline styles lets through.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from xml.etree import ElementTree

from riot_bus.vocabulary.errors import needs_extra

COLOURS = {
    "#0a0a01": "var(--ink)",
    "#0a0a02": "var(--soft)",
    "#0a0a03": "var(--line)",
    "#0a0a04": "var(--fail)",
    "#0a0a05": "var(--pass)",
    "#0a0a06": "var(--paper)",
    "#0a0a07": "var(--nominal)",
}
"""Colours to draw with, and the variables of the page, light or dark, that replace them."""

_HREF = "{http://www.w3.org/1999/xlink}href"
_SIZE = re.compile(r"([\d.]+)px")
_URL = re.compile(r"url\(#([^)]+)\)")
_ROOT = ("viewBox",)
_DROPPED = {"metadata", "style"}
_PROPERTIES = {
    "clip-path",
    "fill",
    "fill-opacity",
    "fill-rule",
    "opacity",
    "stroke",
    "stroke-dasharray",
    "stroke-dashoffset",
    "stroke-linecap",
    "stroke-linejoin",
    "stroke-opacity",
    "stroke-width",
    "text-anchor",
}


@contextmanager
def own_style(settings: Mapping[Any, Any]) -> Iterator[None]:
    """Draw with Matplotlib's defaults and some settings, whatever the user's own; texts stay texts, and are untrusted.

    Args:
        settings: Settings of Matplotlib by name.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    with needs_extra("matplotlib", "report"):
        import matplotlib
    with warnings.catch_warnings(), matplotlib.rc_context():
        warnings.simplefilter("ignore")  # names may use letters that the measuring font lacks; the reader has its own
        matplotlib.rcdefaults()
        matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "riot_bus", "text.parse_math": False})
        matplotlib.rcParams.update(settings)
        yield


def embed(source: str, *, ident: str, label: str) -> str:
    """Return the SVG as an element for a page.

    Args:
        source: SVG that matplotlib wrote.
        ident: Prefix of its ids, distinct in the page.
        label: Text for screen readers.
    """
    old = ElementTree.fromstring(source)  # noqa: S314 - written by matplotlib a moment ago
    new = _copy(old, ident=ident)
    new.attrib = {name: new.attrib[name] for name in _ROOT if name in new.attrib}
    new.attrib |= {"class": "plot", "role": "img", "aria-label": label}
    return ElementTree.tostring(new, encoding="unicode")


def _copy(old: ElementTree.Element, *, ident: str) -> ElementTree.Element:
    tag = _bare(old.tag)
    new = ElementTree.Element(tag)
    for name, text in old.attrib.items():
        if name == _HREF:
            new.set("href", f"#{ident}-{text.removeprefix('#')}")
        elif name == "style":
            _spread(new, text)
        elif name == "id":
            if tag in {"clipPath", "path"}:
                new.set("id", f"{ident}-{text}")
        elif name in {"x", "y"}:
            new.set(name, f"{float(text):.1f}")
        elif "}" not in name:
            new.set(name, text)
    clip = new.get("clip-path")
    if clip:
        new.set("clip-path", _URL.sub(lambda found: f"url(#{ident}-{found[1]})", clip))
    new.text, new.tail = (_solid(old.text), _solid(old.tail))
    new.extend(_copy(child, ident=ident) for child in old if _bare(child.tag) not in _DROPPED)
    return new


def _bare(tag: str) -> str:
    return tag.rpartition("}")[2]


def _solid(text: str | None) -> str | None:
    return text if text and text.strip() else None


def _spread(element: ElementTree.Element, style: str) -> None:
    for declaration in style.split(";"):
        name, _, text = declaration.partition(":")
        name, text = name.strip(), text.strip()
        if name in _PROPERTIES:
            element.set(name, COLOURS.get(text, text))
        elif name in {"font", "font-size"} and (size := _SIZE.search(text)):
            element.set("font-size", size[1])
