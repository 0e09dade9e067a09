"""Who talks on links."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus_bridges.mavlink.sketch import LinkSurvey, listen
from riot_bus_mavlink.tlog import tlog_record
from tests.unit.riot_bus_bridges.mavlink.frames import COMMON, frame_of, unknown_frame


def test_speakers_are_told_apart() -> None:
    survey = LinkSurvey(COMMON.targets)
    survey.see(frame_of(source=(1, 1), type=2, autopilot=3), "fc")
    survey.see(frame_of(source=(255, 190), type=6, autopilot=8), "gcs")
    for _ in range(2):
        survey.see(frame_of("COMMAND_LONG", source=(255, 190), target=(1, 1)), "gcs")
    survey.see(unknown_frame(source=(1, 7)), "fc")
    found = survey.speakers
    assert list(found) == [(1, 1), (255, 190), (1, 7)]
    assert (found[1, 1].kind, found[1, 1].autopilot, found[1, 1].link) == (2, 3, "fc")
    assert found[255, 190].messages == {0: 1, 76: 2}
    assert found[255, 190].targets == {1}
    assert found[1, 7].kind is None
    assert survey.skipped == 0


def test_what_is_kept_is_bounded() -> None:
    survey = LinkSurvey(COMMON.targets)
    for number in range(1030):
        survey.see(unknown_frame(source=(1 + number // 256, number % 256)), "fc")
    assert (len(survey.speakers), survey.skipped) == (1024, 6)
    for number in range(1030):
        survey.see(unknown_frame(source=(1, 0), message_id=14_000_000 + number), "fc")
    assert (len(survey.speakers[1, 0].messages), survey.skipped) == (1024, 6 + 7)


def test_links_are_listened_to(tmp_path: Path) -> None:
    file = tmp_path / "flight.tlog"
    frames = [frame_of(source=(1, 1)), frame_of("ATTITUDE", source=(1, 1)), frame_of(source=(9, 9))]
    file.write_bytes(b"".join(tlog_record(10**18 + number, frame.raw) for number, frame in enumerate(frames)))
    survey, specs = listen([f"{file}?rate=0", "/idle=udpin:127.0.0.1:0"], COMMON, seconds=0.3)
    assert [spec.name for spec in specs] == ["flight", "idle"]
    assert {source: speaker.messages for source, speaker in survey.speakers.items()} == {
        (1, 1): {0: 1, 30: 1},
        (9, 9): {0: 1},
    }
    with pytest.raises(ConfigError, match="nothing comes from there"):
        listen([f"tlogwriter:{tmp_path}/new.tlog"], COMMON, seconds=0.1)
    assert not (tmp_path / "new.tlog").exists()
    with pytest.raises(EnvironmentFaultError, match="cannot be read"):
        listen([f"{tmp_path}/none.tlog"], COMMON, seconds=0.1)
