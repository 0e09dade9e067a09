"""Tests of riot's own formats of reports beyond those that authors inherit, and campaigns beside a baseline."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

from riot_bus.findings.known import KnownFinding
from riot_bus.report.campaign_view import CampaignView
from riot_bus_testkit.reports import CAMPAIGNS, HOSTILE_TEXT, CampaignReportConformance, campaign_at


def campaign_with_baseline(name: str, folder: Path, *, note: str = "ticket 12") -> CampaignView:
    """A campaign whose first finding is known, and whose second is fixed; the note is also a remark on the campaign."""
    view = campaign_at(name, folder)
    entries = [KnownFinding.of(one.finding, since="2026-03-01", note=note) for one in view.findings]
    known = {one.fingerprint: one for one in entries[:1]}
    fixed = {one.fingerprint: one.model_copy(update={"fixed": note}) for one in entries[1:2]}
    return replace(view, known=fixed | known, remarks=(note,))


class OwnReportConformance(CampaignReportConformance):
    """A format of campaigns that takes baselines into account."""

    @pytest.mark.parametrize("campaign", CAMPAIGNS)
    def test_every_campaign_is_reported_beside_a_baseline(self, campaign: str, tmp_path: Path) -> None:
        self._is_reported(campaign_with_baseline(campaign, tmp_path), tmp_path)

    def test_notes_of_a_baseline_stay_text(self, tmp_path: Path) -> None:
        def made(name: str, folder: Path) -> CampaignView:
            return campaign_with_baseline("several", folder, note=HOSTILE_TEXT if name == "hostile" else "ticket 12")

        self._is_harmless(tmp_path, made, "harmless")


class MarkdownConformance(OwnReportConformance):
    """A format of Markdown: names become no markup on the page that is made of it, with its tables."""

    markup = True

    def page(self, text: str) -> str:
        return str(MarkdownIt("commonmark").enable("table").render(text))
