"""No example puts a password on a command line, where everybody on the machine can read it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PLACES = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs", "deploy", "examples", "riot_bus", "adapters")
SECRET = re.compile(r"(?:password|private_key_base64|private_key_pem)=(?!@)[^\s`{(]|\w:[^\s/@`]+@[\w.-]+:\d")


def texts() -> list[Path]:
    files = [path for place in PLACES for path in (ROOT / place, *(ROOT / place).rglob("*"))]
    return [
        path for path in files if path.suffix in (".md", ".service", ".toml", ".sh", ".env", ".py") and path.is_file()
    ]


def test_no_example_has_a_password() -> None:
    named = {path.relative_to(ROOT).parts[0] for path in texts()}
    assert set(PLACES) <= named
    wrong = [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for path in texts()
        if path.name != "redaction.py"  # says what is left out
        for line in path.read_text(encoding="utf-8").splitlines()
        if SECRET.search(line)
    ]
    assert wrong == []


@pytest.mark.parametrize(
    ("line", "is_secret"),
    [
        ("riot ctl --cfg transport/auth/usrpwd/password=wonder status", True),
        ("riot play --cfg transport/auth/usrpwd/password=... x", True),
        ("riot record -e tls/bob:wonder@host:7447", True),
        ("riot ctl --cfg transport/auth/usrpwd/password=@/etc/riot/password status", False),
    ],
)
def test_it_would_be_found(line: str, is_secret: bool) -> None:
    assert bool(SECRET.search(line)) is is_secret


def test_the_docs_show_how() -> None:
    for page in ("docs/router.md", "docs/fleet.md", "deploy/riot-agent.service"):
        assert "usrpwd/password=@" in (ROOT / page).read_text(encoding="utf-8"), page
