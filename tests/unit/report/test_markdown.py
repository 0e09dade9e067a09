from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt

from riot_bus.findings.records import FindingRecord
from riot_bus.report.campaign_view import load_campaign
from riot_bus.report.finding_view import load
from riot_bus.report.format import clean
from riot_bus.report.markdown import LONGEST, MarkdownReport, bounded, cell, code
from riot_bus_testkit.reports import campaign_at, view_at
from tests.unit.report.test_campaign_view import several

MARKDOWN = MarkdownIt("commonmark").enable("table")


def cells(markdown: str) -> list[list[str]]:
    """Return the texts of the rows of all tables, as a reader sees them."""
    rows: list[list[str]] = []
    inside = False
    for token in MARKDOWN.parse(markdown):
        if token.type in ("tr_open", "tr_close"):
            inside = token.type == "tr_open"
            rows += [[]] if inside else []
        elif token.type == "inline" and inside:
            rows[-1].append("".join(child.content for child in token.children or [] if child.type != "html_inline"))
    return rows


def test_a_campaign_has_a_table_of_its_findings(tmp_path: Path) -> None:
    campaign_at("finished", tmp_path)
    folder = tmp_path / "findings" / "planner-crash-1f3a"
    record = FindingRecord.load(folder).model_dump()
    rate = {"value": 1.0, "low": 0.4, "high": 1.0, "count": 4, "total": 4}
    FindingRecord.model_validate(record | {"severity": "abort", "rate": rate}).save(folder)
    text = MarkdownReport().render_campaign(load_campaign(tmp_path))
    assert text.startswith("## riot: 1 finding in 120 trials of planner\n")
    head, row, *_ = cells(text)
    assert head == ["failure", "component", "severity", "fresh trials (95 %)", "fails when", "again"]
    assert row[:5] == ["IndexError in costmap.py:update", "planner", "abort", "4 of 4 (40 to 100 %)", "/map:x < 0"]
    assert row[5] == f"riot reproduce {folder}"
    assert "**Not confirmed**\n\n- hang of planner\n" in text
    assert "**Not told**" in text
    assert "### `planner-crash-1f3a` (activated)" in text


def test_why_a_campaign_stopped_early_is_told_if_it_did(tmp_path: Path) -> None:
    campaign_at("finished", tmp_path)
    told = "**Stopped early**\n\n- no route\n"
    assert told in MarkdownReport().render_campaign(load_campaign(tmp_path, problem="no route"))
    assert "Stopped early" not in MarkdownReport().render_campaign(load_campaign(tmp_path))


def test_a_finding_has_what_its_page_has(tmp_path: Path) -> None:
    text = MarkdownReport().render(view_at("until activate", tmp_path))
    assert "`planner` crashes when `/map:x < 0`; " in text
    assert "At `rover/riot.toml:1`:" in text
    assert f"again     riot reproduce {tmp_path}" in text
    assert ["field", "fails with", "passes with", "failing log", "passing log"] in cells(text)
    assert ["/map:x", "-1", "52", "trials/fails.mcap", "trials/passes.mcap"] in cells(text)
    assert [
        "failures that the rule predicts occur (precision)",
        "98 of 100 fresh trials",
        "95 %: 93 to 100 %",
    ] in cells(text)
    assert "**What was not tried**" in text


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("inconclusive", "**Doubts**\n\n- rate: nothing came on /plan\n"),
        ("not judged", "**Doubts**\n\n- 3 test cases could not be judged: its process was killed\n"),
        ("not finished", "## riot: not finished: 1 finding of planner so far\n"),
    ],
)
def test_doubts_are_told(name: str, words: str, tmp_path: Path) -> None:
    assert words in MarkdownReport().render_campaign(campaign_at(name, tmp_path))


def test_findings_of_other_code_are_named_and_not_counted(tmp_path: Path) -> None:
    campaign_at("finished", tmp_path)
    folder = tmp_path / "findings" / "planner-crash-1f3a"
    FindingRecord.load(folder).model_copy(update={"fingerprint": "other"}).save(folder)
    text = MarkdownReport().render_campaign(load_campaign(tmp_path))
    assert "**Found with other code, not seen again**\n\n- planner-crash-1f3a\n" in text
    assert cells(text) == []


TEXTS = st.text(st.characters(exclude_categories=["Cs"]) | st.sampled_from("`|\\<>&*_[]()@#!~ \n"), max_size=40)


@given(TEXTS)
def test_code_is_read_as_it_was_written(text: str) -> None:
    (_, inline, _) = MARKDOWN.parse(f"a {code(text)} b")
    wanted = clean(text) or " "
    shown = "".join(child.content for child in inline.children or [])
    assert shown == f"a {wanted} b"


@given(st.lists(TEXTS, min_size=1, max_size=3))
def test_cells_are_read_as_they_were_written(texts: list[str]) -> None:
    head = f"|{'a|' * len(texts)}\n|{'-|' * len(texts)}\n"
    _, found = cells(f"{head}| {' | '.join(map(cell, texts))} |\n")
    assert [" ".join(one.split()) for one in found] == [" ".join(clean(text).split()) for text in texts]


@pytest.mark.parametrize(
    "text", ["@someone", "#12", "http://x.y", "www.x.y", "a@b.c", "![x](y)", "owner/name#1", "<b>"]
)
def test_nobody_is_called_and_nothing_linked(text: str, tmp_path: Path) -> None:
    view = view_at("until test", tmp_path)
    changes = {"component": text, "signature": text, "monitor": text, "details": (text,), "severity": text}
    view.finding.model_copy(update=changes).save(tmp_path)
    made = MarkdownReport().render(load(tmp_path))
    plain = [
        child.content
        for token in MARKDOWN.parse(made)
        for child in token.children or []
        if child.type not in ("code_inline", "html_inline")
    ]
    assert not any(text in each for each in plain) or text == "<b>"
    assert "<b>" not in MARKDOWN.render(made)


def test_a_topic_does_not_make_code_of_a_sentence() -> None:
    assert cell("267 on press/drive/command") == "267 on press/drive/command"
    assert cell("see //x.y") == "`see //x.y`"


def test_a_block_is_not_ended_by_what_is_in_it(tmp_path: Path) -> None:
    view = view_at("until test", tmp_path)
    view.finding.model_copy(update={"details": ("a\n```\n<b>x</b>\n~~~", "````")}).save(tmp_path)
    tokens = MARKDOWN.parse(MarkdownReport().render(load(tmp_path)))
    assert next(token.content for token in tokens if token.type == "fence") == "a\n```\n<b>x</b>\n~~~\n````\n"


def test_what_does_not_fit_is_left_out_and_told(tmp_path: Path) -> None:
    for number in range(150):
        folder = tmp_path / "findings" / f"{number:03}"
        folder.mkdir(parents=True)
        view_at("until rules", folder)
    text = MarkdownReport().render_campaign(load_campaign(tmp_path))
    assert len(text) <= LONGEST
    assert f"left out, as GitHub takes 65536 characters: `riot findings {tmp_path}` tells all." in text
    assert len(cells(text)) > 150, "all are in the table"


def test_bounded_keeps_whole_parts() -> None:
    parts = ["a" * 100, "b" * 100, "c" * 100]
    assert bounded(parts, where="x", longest=300) == "".join(parts)
    for longest, kept, told in ((299, "a" * 100 + "b" * 100, "1 part"), (260, "a" * 100, "2 parts")):
        text = bounded(parts, where="x", longest=longest)
        assert text.startswith(f"{kept}\n\n{told} left out, as GitHub takes")
        assert len(text) <= longest


def test_a_table_says_what_the_baseline_knows(tmp_path: Path) -> None:
    view = several(tmp_path)
    heads, *rows = cells(MarkdownReport().render_campaign(replace(view, remarks=("fixed: x | y",))))
    assert heads[-1] == "baseline"
    assert [row[-1] for row in rows[:3]] == ["known: since 2026-03-01", "came back: was fixed 2026-03-02", "new"]
    assert "**Played again**" in MarkdownReport().render_campaign(replace(view, remarks=("x",)))
    assert cells(MarkdownReport().render_campaign(replace(view, known=None)))[0][-1] == "again"
