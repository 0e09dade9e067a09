from __future__ import annotations

import pytest

from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus_logtools.editing.channel_edit import EditStep, Trouble
from riot_bus_logtools.editing.selection import parse_selection


def test_an_action_that_never_succeeds_is_an_error() -> None:
    trouble = Trouble("--set 'a'")
    trouble.check()
    trouble.fail(PayloadError("no such field", where="x"))
    with pytest.raises(ConfigError, match="no such field"):
        trouble.check()
    for _ in range(998):
        trouble.fail(PayloadError("no such field", where="x"))
    with pytest.raises(ConfigError):
        trouble.fail(PayloadError("no such field", where="x"))


def test_an_action_that_fails_at_times_is_a_warning() -> None:
    step = EditStep(parse_selection("/a where x > 1", "--drop"))
    step.reading.succeeded = 1
    step.reading.fail(PayloadError("too short"))
    (line,) = step.warnings()
    assert "1 messages are not selected" in line
