from __future__ import annotations

import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from riot_bus.report.backtrack_picture import check_picture, draw_picture
from riot_bus.vocabulary.errors import ConfigError, MissingExtraError
from tests.unit.report.backtracks import RECORD


def test_a_picture_has_all_topics_and_is_the_same_each_time(tmp_path):
    draw_picture(RECORD, tmp_path / "a.svg")
    draw_picture(RECORD, tmp_path / "b.svg")
    text = (tmp_path / "a.svg").read_text()
    words = "".join(ElementTree.fromstring(text).itertext())
    for topic in ("/unit", "/map", "/goal", "/odom", "/lost"):
        assert topic in words
    assert "12 %" in words
    assert text == (tmp_path / "b.svg").read_text()


def test_other_kinds_of_pictures_are_refused_before_anything_is_read():
    with pytest.raises(ConfigError, match=r"did you mean '\.png'"):
        check_picture(Path("a.pngg"))
    check_picture(Path("a.PNG"))


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match="report"):
        check_picture(Path("a.png"))
