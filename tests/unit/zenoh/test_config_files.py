from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.config_files import TLS, USERS, absolute_file, endpoint_files, settings_of_text
from riot_bus.zenoh.session_config import client_config

PASSWORD = f"{USERS}/password"


def private(path: Path, data: bytes | str = b"", mode: int = 0o600) -> Path:
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    path.chmod(mode)
    return path


@pytest.mark.parametrize(
    ("held", "value"),
    [
        ("secret\n", "secret"),
        ("secret\r\n", "secret"),
        ("secret", "secret"),
        (" a b\n\n", " a b\n"),
        ("1234\n", "1234"),
        ('"quoted"\n', '"quoted"'),
        ("@text\n", "@text"),
        ("pässword\n", "pässword"),
        ("x" * (64 << 10), "x" * (64 << 10)),
    ],
)
def test_a_value_is_what_its_file_holds(tmp_path: Path, held: str, value: str) -> None:
    private(tmp_path / "password", held)
    assert settings_of_text(PASSWORD, "@password", tmp_path, where="--cfg") == {PASSWORD: value}
    assert settings_of_text(PASSWORD, f"@{tmp_path}/password", Path("/"), where="--cfg") == {PASSWORD: value}


def test_a_file_may_hold_json_where_zenoh_takes_no_text(tmp_path: Path) -> None:
    private(tmp_path / "file", "{user: 'bob', password: 'secret'}\n")
    found = settings_of_text(USERS, "@file", tmp_path, where="--cfg")
    assert (found[f"{USERS}/user"], found[PASSWORD]) == ("bob", "secret")


def test_a_value_that_begins_with_at_is_written_as_json(tmp_path: Path) -> None:
    assert settings_of_text(PASSWORD, '"@text"', tmp_path, where="--cfg") == {PASSWORD: "@text"}


@pytest.mark.parametrize(
    ("key", "held", "words"),
    [
        (PASSWORD, None, ("there is no file", "/file")),
        (PASSWORD, b"\xff-secret", ("UTF-8", "/file")),
        (PASSWORD, b"secret" * 11_000, ("64 KiB", "/file")),
        ("timestamping/enabled", b"secret", ("'timestamping/enabled'", "/file")),
        ("transport/auth/usrpwd/pasword", b"secret", ("no key", "did you mean")),
        (f"{TLS}/connect_private_key", b"secret", ("is the path of a file", "leave the @ out")),
    ],
)
def test_what_a_file_holds_is_in_no_error(tmp_path: Path, key: str, held: bytes | None, words: tuple[str, ...]) -> None:
    if held is not None:
        private(tmp_path / "file", held)
    with pytest.raises(ConfigError) as caught:
        settings_of_text(key, "@file", tmp_path, where="--cfg")
    assert "--cfg" in str(caught.value)
    assert "secret" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


SECRETS = [
    f"{TLS}/listen_private_key",
    f"{TLS}/connect_private_key",
    f"{USERS}/dictionary_file",
    "transport/auth/pubkey/private_key_file",
]


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o620, 0o604, 0o601])
def test_secrets_that_others_may_read_are_refused(tmp_path: Path, mode: int) -> None:
    file = private(tmp_path / "a file", "secret", mode)
    calls = [
        *(lambda key=key: absolute_file(key, "a file", tmp_path, where="here") for key in SECRETS),
        lambda: settings_of_text(PASSWORD, "@a file", tmp_path, where="here"),
        lambda: endpoint_files("tls/h:1#listen_private_key_file=a file", tmp_path, where="here"),
        lambda: client_config(f"tls/h:1#so_sndbuf=1;connect_private_key_file={file}"),
    ]
    for call in calls:
        with pytest.raises(ConfigError, match=f"others may read {file} .mode {mode:04o}") as caught:
            call()
        assert caught.value.hint == f"chmod 600 '{file}'"


@pytest.mark.parametrize("mode", [0o600, 0o400])
def test_secrets_of_one_user_are_taken(tmp_path: Path, mode: int) -> None:
    file = private(tmp_path / "file", "secret", mode)
    for key in SECRETS:
        assert absolute_file(key, "file", tmp_path, where="here") == str(file)
    endpoint = f"tls/h:1#connect_private_key_file={file}"
    assert endpoint_files("tls/h:1#connect_private_key_file=file", tmp_path, where="here") == endpoint
    assert client_config(endpoint)["connect/endpoints"] == [endpoint]


def test_certificates_are_for_everybody(tmp_path: Path) -> None:
    file = private(tmp_path / "ca.pem", mode=0o644)
    for key in (f"{TLS}/root_ca_certificate", f"{TLS}/listen_certificate", "transport/auth/pubkey/public_key_file"):
        assert absolute_file(key, "ca.pem", tmp_path, where="here") == str(file)
    assert endpoint_files("tls/h:1#root_ca_certificate_file=ca.pem", tmp_path, where="here").endswith(str(file))


def test_credentials_of_systemd_show_an_acl_as_their_mode(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "credentials").mkdir()
    inside = private(tmp_path / "credentials/key", "secret", 0o440)
    private(tmp_path / "key", "secret", 0o440)
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path / "credentials"))
    assert absolute_file(SECRETS[0], str(inside), tmp_path, where="here") == str(inside)
    with pytest.raises(ConfigError, match="mode 0440"):
        absolute_file(SECRETS[0], "credentials/../key", tmp_path, where="here")
