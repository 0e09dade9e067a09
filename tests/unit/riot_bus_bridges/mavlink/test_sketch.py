"""A first system file from what was heard."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.system.system_file import SystemFile
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus_bridges.mavlink.sketch import LinkSurvey, sketch, sketch_json, sketch_toml
from riot_bus_bridges.mavlink.url import parse_links
from tests.unit.riot_bus_bridges.mavlink.frames import COMMON, frame_of

SPECS = parse_links(["/fc=/dev/ttyACM0,115200", "/radio.1=udpin:0.0.0.0:14550?group=a"])


def heard(*, ground: bool = True) -> LinkSurvey:
    survey = LinkSurvey(COMMON.targets)
    for _ in range(4):
        survey.see(frame_of(source=(1, 1), type=2, autopilot=3), "fc")
        survey.see(frame_of("ATTITUDE", source=(1, 1)), "fc")
    survey.see(frame_of("ATTITUDE", source=(1, 100)), "radio.1")
    if ground:
        survey.see(frame_of(source=(255, 190), type=6, autopilot=8), "radio.1")
    return survey


def parsed(text: str) -> dict[str, Any]:
    found = tomllib.loads(text)
    SystemFile.model_validate({**found, "path": Path("riot.toml").resolve()})
    return found


def test_a_ground_station_is_tested_with_what_an_autopilot_says() -> None:
    found = sketch(heard(), SPECS, COMMON, seconds=2)
    assert [part.name for part in found.outside] == ["fc", "radio_1"]
    assert found.outside[0].who == ["1/1 (QUADROTOR, ARDUPILOTMEGA)"]
    assert found.outside[0].topics == {"mavlink_raw/fc/1/1/ATTITUDE": 2.0, "mavlink_raw/fc/1/1/HEARTBEAT": 2.0}
    assert found.unit.who == ["255/190 (GCS)"]
    text = sketch_toml(found, origin="what came")
    system = parsed(text)
    assert '    "mavlink_raw/fc/1/1/ATTITUDE",          # 2/s\n' in text
    assert system["components"]["fc"]["command"][-2:] == ["--link", "/fc=/dev/ttyACM0,115200"]
    assert system["components"]["radio_1"]["command"][-1] == "/radio.1=udpin:0.0.0.0:14550?group=a"
    assert system["components"]["fc"]["external"]
    unit = system["components"]["unit"]
    assert unit["segment"] == "inside"
    assert "/unit=udpin:127.0.0.1:0" in unit["command"]
    assert unit["outputs"] == ["mavlink_raw/unit/255/190/HEARTBEAT"]
    assert unit["inputs"] == system["external"]["topics"]
    assert len(unit["inputs"]) == 3
    assert list(system["unit"]) == ["unit"]
    assert sketch_json(found)["unit"]["topics"] == found.unit.topics


def test_the_user_says_what_is_tested() -> None:
    found = sketch(heard(), SPECS, COMMON, seconds=2, unit=1)
    assert found.unit.who == ["1/1 (QUADROTOR, ARDUPILOTMEGA)", "1/100"]
    assert [part.who for part in found.outside] == [["255/190 (GCS)"]]
    parsed(sketch_toml(found, origin="x"))
    alone = sketch(heard(ground=False), SPECS, COMMON, seconds=2)
    assert (alone.unit.who, len(alone.outside)) == ([], 2)
    parsed(sketch_toml(alone, origin="x"))
    with pytest.raises(ConfigError, match="heard: 1, 255"):
        sketch(heard(), SPECS, COMMON, seconds=2, unit=9)
    with pytest.raises(EnvironmentFaultError, match="nothing was heard"):
        sketch(LinkSurvey(COMMON.targets), SPECS, COMMON, seconds=2)


@given(st.text(max_size=40), st.integers(0, 255), st.integers(0, 255))
def test_whatever_is_heard_gives_a_valid_file(origin: str, kind: int, autopilot: int) -> None:
    survey = LinkSurvey(COMMON.targets)
    survey.see(frame_of(source=(0, 0), type=kind, autopilot=autopilot), "unit")
    survey.see(frame_of(source=(2, 0), type=kind, autopilot=autopilot), "unit")
    specs = parse_links(['/unit=serial:/dev/a"\\\U0001f680\x7f:9600'])
    system = parsed(sketch_toml(sketch(survey, specs, COMMON, seconds=1), origin=origin))
    assert "unit_2" in system["components"]
