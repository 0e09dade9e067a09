from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_fleet.evidence.picture import check_picture, dot, write_picture
from tests.unit.riot_bus_fleet.evidence.backtracks import RECORD


def test_a_picture_has_all_topics_and_is_the_same_each_time(tmp_path):
    write_picture(RECORD, tmp_path / "a.svg")
    write_picture(RECORD, tmp_path / "b.svg")
    text = (tmp_path / "a.svg").read_text()
    words = "".join(ElementTree.fromstring(text).itertext())
    for topic in ("/unit", "/map", "/goal", "/odom", "/lost"):
        assert topic in words
    assert "12 %" in words
    assert text == (tmp_path / "b.svg").read_text()


def test_other_kinds_of_pictures_are_refused_before_anything_is_read():
    with pytest.raises(ConfigError, match="rsvg-convert"):
        check_picture(Path("a.png"))
    check_picture(Path("a.SVG"))


def test_dot_escapes_names_and_shows_evidence():
    text = dot(RECORD)
    assert text.startswith("digraph riot {")
    assert '[shape=ellipse, label="/unit", penwidth=3];' in text
    assert 'label="/odd\\"\\\\\\\\x1b"' in text
    assert '[style=solid, label="planner\\n12 %"];' in text
    assert '[style=dotted, label="planner"];' in text
    assert '[style=dashed, label="unknown writer of /unit\\n12 %"];' in text
