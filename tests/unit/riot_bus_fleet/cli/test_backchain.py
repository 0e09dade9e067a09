from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from riot_bus.cli.main import make_app
from tests.unit.chain.offline import known_graph, write_log


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder, rng = tmp_path_factory.mktemp("logs"), np.random.default_rng(1)
    return [str(write_log(folder / f"{at}.mcap", rng, count=120, graph=known_graph())) for at in range(2)]


def run(*arguments):
    return CliRunner().invoke(make_app("backchain"), ["backchain", *arguments])


def test_the_picture_is_drawn(logs, tmp_path):
    assert run(*logs, "--to", "unit:v", "--picture", str(tmp_path / "way.svg")).exit_code == 0
    assert (tmp_path / "way.svg").stat().st_size > 1000


def test_text_json_and_dot(logs):
    done = run(*logs, "--to", "unit:v")
    assert done.exit_code == 0, done.output
    assert "└─ map by /planner\n      v follows v: " in done.output
    assert json.loads(run(logs[0], "--to", "unit:v", "--format", "json").stdout)["targets"] == {"unit:v": ""}
    assert run(logs[0], "--to", "unit:v", "--format", "dot").stdout.startswith("digraph riot {")


def test_a_field_that_cannot_be_told_of_ends_with_5(logs):
    done = run(*logs, "--to", "unit:mode")
    assert done.exit_code == 5
    assert "unit:mode cannot be tested: it never changes within a log" in done.output
