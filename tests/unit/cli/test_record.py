from __future__ import annotations

import pytest

from riot_bus.cli.record import _command, _notes
from riot_bus.vocabulary.errors import ConfigError


def test_passwords_do_not_get_into_the_log() -> None:
    words = ["/usr/bin/riot", "record", "--cfg", "transport/auth/usrpwd/password=secret", "--cfg=a/b=secret", "a b/**"]
    assert _command(words) == "riot record --cfg transport/auth/usrpwd/password=... --cfg=a/b=... 'a b/**'"
    assert _command(["x", "--cfg"]) == "riot --cfg"
    assert _command(["x", "--fleet-cfg", "a/b=secret"]) == "riot --fleet-cfg a/b=..."
    assert _command(["x", "-e", "tls/h:1#a=secret;b=c d"]).startswith("riot -e 'tls/h:1#...")
    assert (
        _command(["x", "--endpoint=tcp/u:secret@h:1", "--note=see #7"]) == "riot --endpoint=tcp/...@h:1 '--note=see #7'"
    )


def test_notes_are_pairs() -> None:
    assert _notes(["a=b=c", "d="]) == {"a": "b=c", "d": ""}
    for text in ("a", "=b"):
        with pytest.raises(ConfigError, match="not a note"):
            _notes([text])
