from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_logtools.comparison.page import write_diff_page
from tests.unit.riot_bus_logtools.comparison.recordings import said, told


def rows(count: int = 40) -> list[dict[str, object]]:
    return [{"n": number, "x": 1.0} for number in range(count)]


def test_what_differs_is_on_the_page(tmp_path: Path) -> None:
    other = [{**row, "x": 2.5} if number == 10 else row for number, row in enumerate(rows())]
    found = told([*said(*rows()), *said(b"1", key="b")], [*said(*other[:30], *other[31:]), *said(b"1", key="b")])
    text = write_diff_page(found, tmp_path / "diff.html").read_text(encoding="utf-8")
    assert text.count("<h2><code>") == 1
    assert "38 of 40 → 39 equal, 1 changed, 1 lost." in text
    assert "<dt>lost</dt><dd>#30</dd>" in text
    assert "<code>1.0</code></td><td><code>2.5</code>" in text
    assert "M120.0 24v-24.0h12.0v24.0z" in text.replace("M120.0", "M120.0")
    (picture,) = [f"<svg{part.partition('</svg>')[0]}</svg>" for part in text.split("<svg")[1:]]
    assert len(ElementTree.fromstring(picture)) == 2


def test_the_same_logs_make_a_page_too(tmp_path: Path) -> None:
    found = told(said(*rows()), said(*rows()))
    text = write_diff_page(found, tmp_path / "diff.html").read_text(encoding="utf-8")
    assert '<span class="badge">the same</span>' in text
    assert "<svg" not in text


def test_what_logs_hold_is_shown_and_not_obeyed(tmp_path: Path) -> None:
    evil = "<script>alert(1)</script>"
    found = told(said({evil: evil}, key=f"t{evil}"), said({evil: f"{evil}!"}, key=f"t{evil}"))
    text = write_diff_page(found, tmp_path / "diff.html").read_text(encoding="utf-8")
    assert "<script" not in text
    assert "&lt;script&gt;" in text


def test_pages_are_bounded(tmp_path: Path) -> None:
    wide = [{f"f{number}": value for number in range(500)} for value in (1, 2)]
    topics = [message for number in range(300) for message in said(b"1", key=f"t{number:03d}")]
    found = told([*said(*wide[:1]), *topics], [*said(*wide[1:]), *topics])
    text = write_diff_page(found, tmp_path / "diff.html").read_text(encoding="utf-8")
    assert "And 400 further fields." in text.replace("\N{NO-BREAK SPACE}", " ")
    assert "And 101 further topics." in text.replace("\N{NO-BREAK SPACE}", " ")


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot write"):
        write_diff_page(told(said(*rows()), said(*rows())), tmp_path / "none" / "diff.html")
