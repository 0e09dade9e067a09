"""`riot cluster check` refuses what it must not connect to."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from riot_bus.cli.main import make_app
from riot_bus.vocabulary.errors import ConfigError


def test_another_machine_without_tls_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "riot.toml"
    path.write_text('[components.one]\ncommand = ["true"]\n[unit.one]\n')
    with pytest.raises(ConfigError, match="there is no TLS"):
        CliRunner().invoke(
            make_app("cluster"),
            ["cluster", "check", "dask://10.1.2.3:8786", f"--system={path}"],
            catch_exceptions=False,
        )
