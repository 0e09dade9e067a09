"""What is installed, and from where: no name that anybody could register, no action that can change."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from riot_bus.ci.ci_init import WORKFLOWS, init_ci
from riot_bus.vocabulary.errors import MissingExtraError

ROOT = Path(__file__).resolve().parents[2]
OWN = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
TREES = ("riot_bus", "adapters", "docs", "deploy", "examples", "benchmarks", ".github", ".ci")
ENDINGS = (".py", ".md", ".yml", ".yaml", ".service", ".toml", ".html", "Dockerfile", "run")


def jobs(path: Path) -> dict[str, Any]:
    yaml = pytest.importorskip("yaml")
    found: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"]
    return found


def test_nothing_installs_riot_bus_by_its_name_which_is_not_on_pypi_yet() -> None:
    files = [path for tree in TREES for path in (ROOT / tree).rglob("*") if path.name.endswith(ENDINGS)]
    files += [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "bootstrap.py", "mkdocs.yml")]
    assert len(files) > 500
    named = re.compile(r"\b(?:pip|pipx|uv|uvx)\b[^#:]*[\s'\"]riot[-_]bus(?:\[[^\]]*\])?(?! @)['\"`\s]")
    wrong = [f"{path}: {line}" for path in files for line in path.read_text().splitlines() if named.search(f"{line} ")]
    assert not wrong
    assert named.search("pip install 'riot-bus[x]' "), "the pattern finds what it should"


def test_a_hint_names_the_checkout_and_says_why() -> None:
    hint = MissingExtraError("scipy", "analysis").hint
    assert hint == "pip install '.[analysis]' in a checkout, or 'FILE.whl[analysis]': riot_bus is not on PyPI yet"


@pytest.mark.parametrize("path", OWN, ids=lambda path: path.name)
def test_actions_are_commits_and_checkouts_keep_no_token(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    uses = re.findall(r"uses: (.+)", text)
    assert uses
    assert all(re.fullmatch(r"[\w./-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", each) for each in uses), uses
    assert text.count("uses: actions/checkout@") == text.count("persist-credentials: false")


def test_a_job_that_holds_a_token_runs_nothing_that_is_installed() -> None:
    for name, job in jobs(ROOT / ".github" / "workflows" / "release.yml").items():
        held = {right for right, value in job.get("permissions", {}).items() if value == "write"}
        commands = [step["run"] for step in job["steps"] if "run" in step]
        assert not held or all(each.startswith("gh ") for each in commands), name
        assert "id-token" not in held or name == "publish"


def test_the_workflow_that_users_get_names_a_commit_and_keeps_no_token(tmp_path: Path) -> None:
    init_ci(tmp_path, github=True, gitlab=True)
    texts = {kind: (tmp_path / path).read_text(encoding="utf-8") for kind, path in WORKFLOWS.items()}
    for text in texts.values():
        assert "riot_bus is not on PyPI yet" in text
        assert re.findall(r"pip install (\S+ @ \S+)", text)[0] == '"riot-bus[analysis] @ $RIOT_FROM"'
        assert "RIOT_FROM: git+https://FILL-IN.invalid/riot_bus@COMMIT\n" in text, "no host that there could be"
    assert texts["github"].count("actions/checkout@") == texts["github"].count("persist-credentials: false") == 2
