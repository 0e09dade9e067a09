"""What is set in which node, and what is told of refusals; how it is set is tested with processes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from riot_bus.trial.context import Context, open_system
from riot_bus.trial.readiness import set_in_nodes
from riot_bus.types.capabilities import ParameterRequest
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.message import Scalar
from riot_bus_ros2.adapter import Ros2Adapter

SYSTEM = """
[components.a]
command = ["a"]
[external.parameters]
gain = { nominal = 1.0, range = [-2, 99], node = "/planner" }
other = { nominal = 3, range = [0, 99], node = "/arm", name = "gain" }
calm = { nominal = true, node = "/planner" }
speed = { nominal = 1.0, range = [0, 2] }
"""


class Nodes(Ros2Adapter):
    """Nodes that take numbers up to 10, and say nothing of 77.

    Attributes:
        asked: All that was to be set.
    """

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[tuple[str, dict[str, Scalar]]] = []

    def set_parameters(self, request: ParameterRequest) -> Mapping[str, str]:
        values = request.values
        self.asked.append((request.node, dict(values)))
        if 77 in values.values():
            raise EnvironmentFaultError(f"{request.node} has not answered")
        return {name: "at most 10" for name, value in values.items() if isinstance(value, int | float) and value > 10}


def system(folder: Path, text: str = SYSTEM) -> tuple[Context, Nodes]:
    (folder / "riot.toml").write_text(text)
    nodes = Nodes()
    return replace(open_system(folder / "riot.toml"), registry=TypeRegistry([nodes])), nodes


def refused(context: Context, chosen: Mapping[str, Scalar]) -> dict[str, str]:
    return set_in_nodes(context, chosen, [], timeout=1.0, alive=lambda: True)


def test_each_node_gets_chosen_and_nominal_values_by_its_own_names(tmp_path: Path) -> None:
    context, nodes = system(tmp_path)
    assert refused(context, {"gain": 2, "speed": 0.5}) == {}
    assert nodes.asked == [("/planner", {"gain": 2.0, "calm": True}), ("/arm", {"gain": 3})]
    assert type(nodes.asked[0][1]["gain"]) is float


def test_instead_of_a_refused_value_the_nominal_one_is_set(tmp_path: Path) -> None:
    context, nodes = system(tmp_path)
    assert refused(context, {"gain": 12.0, "calm": False}) == {"gain": "/planner refused 12.0: at most 10"}
    assert nodes.asked[:2] == [("/planner", {"gain": 12.0, "calm": False}), ("/planner", {"gain": 1.0})]


def test_a_node_that_says_nothing_of_a_value_has_not_taken_it(tmp_path: Path) -> None:
    context, _ = system(tmp_path)
    assert refused(context, {"gain": 77.0}) == {"gain": "/planner refused 77.0: /planner has not answered"}


@pytest.mark.parametrize(
    ("nominal", "error", "told"),
    [
        ("12.0", ConfigError, "external.parameters.gain: /planner refuses the nominal value 12.0: at most 10"),
        ("77.0", EnvironmentFaultError, "external.parameters: /planner has not answered"),
    ],
)
def test_nominal_values_have_to_be_taken(tmp_path: Path, nominal: str, error: type[Exception], told: str) -> None:
    context, _ = system(tmp_path, SYSTEM.replace("gain = { nominal = 1.0", f"gain = {{ nominal = {nominal}"))
    with pytest.raises(error) as caught:
        refused(context, {})
    assert told in str(caught.value)
