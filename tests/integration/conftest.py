from __future__ import annotations

from pathlib import Path

import pytest

from tests.interop import SDK, require


@pytest.fixture(scope="session")
def python() -> Path:
    """An interpreter that has zenoh-ros2-sdk."""
    return require(SDK)
