"""The workflows that are written: what they run is what riot takes, and what the page shows."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
import typer

from riot_bus.ci.ci_init import WORKFLOWS, init_ci
from riot_bus.cli.main import make_app
from riot_bus.vocabulary.errors import ConfigError

PAGE = (Path(__file__).parents[3] / "docs" / "ci.md").read_text(encoding="utf-8")
TEXTS = {
    kind: (Path(init_ci.__code__.co_filename).parent / "templates" / f"{kind}.yml").read_text() for kind in WORKFLOWS
}


@pytest.mark.parametrize("kind", WORKFLOWS)
def test_what_is_written_has_the_jobs_that_the_page_names(kind: str, tmp_path: Path) -> None:
    init_ci(tmp_path, **{kind: True})
    text = (tmp_path / WORKFLOWS[kind]).read_text(encoding="utf-8")
    (row,) = (line for line in PAGE.splitlines() if line.startswith(f"| `{WORKFLOWS[kind]}`"))
    told = re.findall(r"`(riot-)?(change|nightly)`", row)
    assert len(told) == 2
    for prefix, job in told:
        assert re.search(rf"^ *{prefix}{job}:$", text, re.MULTILINE), job
    assert "FILL IN" in text


@pytest.mark.parametrize("kind", WORKFLOWS)
def test_each_line_that_runs_riot_is_one_that_riot_takes(kind: str) -> None:
    text = re.sub(r"\$\{\{.*?\}\}|\$\w+", "7", TEXTS[kind].replace("\\\n", " "))
    lines = re.findall(r"^\s*(?:- |run: |- run: )?(riot ci .*?)(?: \|\| .*)?$", text, re.MULTILINE)
    assert len(lines) == 3
    group = typer.main.get_group(make_app("ci")).commands["ci"]
    for line in lines:
        name, *words = shlex.split(line)[2:]
        command = group.get_command(None, name)  # type: ignore[attr-defined]
        command.make_context(name, words)


def test_permissions_are_the_least_and_actions_have_a_version() -> None:
    text = TEXTS["github"]
    assert text.count("permissions:\n  contents: read\n") == 1
    assert set(re.findall(r"^ +(\w[\w-]*): (?:read|write)$", text, re.MULTILINE)) == {"contents", "security-events"}
    assert "contents: write" not in text
    uses = re.findall(r"uses: (\S+)", text)
    assert uses
    assert all(re.fullmatch(r"(actions|github)/[\w/-]+@v\d+", each) for each in uses)
    assert "${{ github.event.pull_request" not in text, "texts of others do not get into a shell"
    assert text.count("if: always()") >= 6


def test_yaml_is_valid_and_has_both_jobs() -> None:
    yaml = pytest.importorskip("yaml")
    github, gitlab = (yaml.safe_load(TEXTS[kind]) for kind in ("github", "gitlab"))
    assert set(github["jobs"]) == {"change", "nightly"}
    assert {"riot-change", "riot-nightly"} <= set(gitlab)


def test_a_file_that_is_there_is_only_replaced_by_force(tmp_path: Path) -> None:
    path = tmp_path / WORKFLOWS["github"]
    path.parent.mkdir(parents=True)
    path.write_text("mine")
    with pytest.raises(ConfigError, match="a workflow exists already") as problem:
        init_ci(tmp_path, github=True, gitlab=True)
    assert problem.value.where == str(path)
    assert path.read_text() == "mine"
    assert not (tmp_path / WORKFLOWS["gitlab"]).exists(), "all or nothing"
    assert init_ci(tmp_path, github=True, gitlab=True, force=True)[:2] == [
        f"written: {tmp_path / WORKFLOWS[kind]}" for kind in ("github", "gitlab")
    ]
    assert path.read_text() == TEXTS["github"]


def test_which_one_is_seen_by_what_is_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="neither GitHub nor GitLab"):
        init_ci(tmp_path)
    (tmp_path / ".gitlab-ci.yml").write_text("")
    assert init_ci(tmp_path)[0] == f"written: {tmp_path / '.gitlab-ci.riot.yml'}"


def test_what_is_next_is_what_is_missing(tmp_path: Path) -> None:
    first = "\n".join(init_ci(tmp_path, github=True))
    assert "write riot.toml" in first
    assert "add riot-out/ to .gitignore" in first
    assert "riot ci batch --update" in first
    (tmp_path / "riot.toml").write_text("")
    (tmp_path / ".gitignore").write_text("riot-out/\n")
    (tmp_path / "riot-baseline.json").write_text("{}")
    second = "\n".join(init_ci(tmp_path, github=True, force=True))
    assert "FILL IN" in second
    assert not {"riot.toml:", "gitignore", "batch"} & set(second.split())


def test_what_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / ".github").write_text("")
    with pytest.raises(ConfigError, match="cannot write the workflow"):
        init_ci(tmp_path, github=True)
