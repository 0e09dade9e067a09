from __future__ import annotations

import pytest

from riot_bus.draft.model import CommandDraft, DraftComponent, Used, draft_of, free_name
from riot_bus.vocabulary.errors import ConfigError


def part(
    name: str, reads: str = "", writes: str = "", *, segment: str = "", nodes: tuple[str, ...] = ()
) -> DraftComponent:
    inputs, outputs = (tuple(map(Used, topics.split())) for topics in (reads, writes))
    return DraftComponent(
        name=name, command=CommandDraft((name,)), inputs=inputs, outputs=outputs, segment=segment, nodes=nodes
    )


CAMERA, TELEOP = part("camera", writes="image"), part("teleop", reads="image", writes="goal")
PLANNER, MOTOR = part("planner", reads="goal image", writes="path"), part("motor", reads="path", writes="odom")
ALL = (CAMERA, TELEOP, PLANNER, MOTOR)


def outside(parts: tuple[DraftComponent, ...]) -> set[str]:
    return {each.name for each in parts if each.external}


def test_what_subscribes_to_nothing_is_external() -> None:
    draft = draft_of(ALL)
    assert outside(draft.parts) == {"camera"}
    assert draft.external == {"image": "from camera"}
    assert {each.name: each.segment for each in draft.parts} == {
        "camera": "outside",
        "teleop": "inside",
        "planner": "inside",
        "motor": "inside",
    }
    assert outside(draft_of([part("idle")]).parts) == set()


def test_whom_the_user_names_is_external_and_nobody_else() -> None:
    draft = draft_of(ALL, external=["teleop"])
    assert outside(draft.parts) == {"teleop"}
    assert draft.external == {"goal": "from teleop"}


def test_topics_without_a_publisher_are_external_if_they_reach_the_unit() -> None:
    lonely = part("logger", reads="battery path")
    assert draft_of([*ALL, lonely]).external == {"battery": "no publisher was seen", "image": "from camera"}
    assert draft_of([*ALL, lonely], unit="planner").external == {"image": "from camera"}


def test_if_nothing_external_reaches_the_unit_what_feeds_it_is_external() -> None:
    ring = (part("a", "c", "a"), part("b", "a", "b"), part("c", "b", "c"), part("clock", writes="time"))
    draft = draft_of(ring, unit="b")
    assert outside(draft.parts) == {"a", "clock"}
    assert draft.external == {"a": "from a"}
    assert "it feeds b" in draft.parts[0].external
    own = (part("a", "c b", "a"), part("b", "a b", "b"), part("c", "b", "c"))
    assert outside(draft_of(own, unit="b").parts) == {"a"}  # what it tells itself does not come from outside


def test_the_unit_stays_inside_even_if_it_subscribes_to_nothing() -> None:
    draft = draft_of(ALL, unit="camera")
    assert "camera" not in outside(draft.parts)
    assert draft.unit == "camera"


def test_segments_of_the_router_are_kept_if_they_separate_the_outside() -> None:
    kept = draft_of([part("a", writes="x", segment="field"), part("b", reads="x", segment="unit")])
    assert [each.segment for each in kept.parts] == ["field", "unit"]
    for first, second in (("same", "same"), ("field", "")):
        mixed = draft_of([part("a", writes="x", segment=first), part("b", reads="x", segment=second)])
        assert [each.segment for each in mixed.parts] == ["outside", "inside"]


def test_components_are_found_by_name_node_and_last_part_of_a_node() -> None:
    parts = [part("p1", writes="x", nodes=("/left/driver",)), part("p2", reads="x", nodes=("/right/driver", "/nav"))]
    assert draft_of(parts, unit="p2").unit == draft_of(parts, unit="nav").unit == "p2"
    assert draft_of(parts, unit="/right/driver").unit == "p2"
    with pytest.raises(ConfigError, match="several nodes are called 'driver'") as caught:
        draft_of(parts, unit="driver")
    assert caught.value.hint == "name one of: p1, p2"
    with pytest.raises(ConfigError, match="no node 'naw' was seen") as caught:
        draft_of(parts, unit="naw")
    assert "nav" in str(caught.value.hint)


def test_one_process_cannot_be_unit_and_external() -> None:
    parts = [part("p", reads="x", nodes=("/nav", "/teleop"))]
    with pytest.raises(ConfigError, match="/nav, /teleop are one process") as caught:
        draft_of(parts, unit="nav", external=["teleop"])
    assert caught.value.where == "--external"


def test_a_command_with_gaps_cannot_start() -> None:
    assert CommandDraft(("run", "x")).can_start
    assert not CommandDraft(("run", "FILL_IN x")).can_start
    assert not CommandDraft(("run",), env={"A": "FILL_IN"}).can_start


def test_names_are_made_of_plain_characters_and_used_once() -> None:
    taken = {"node"}
    found = [free_name(text, taken) for text in ("/robot 1/nav", "robot_1_nav", "/", "ok-1")]
    assert found == ["robot_1_nav", "robot_1_nav_2", "node_2", "ok-1"]
    assert set(found) < taken
