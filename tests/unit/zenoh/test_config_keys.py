from __future__ import annotations

from typing import Any

import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.config_keys import check_config, leaves, value_of, value_of_file

PASSWORD = "transport/auth/usrpwd/password"
TTL = "scouting/multicast/ttl"


def test_tables_are_flattened_down_to_what_zenoh_takes_as_a_whole() -> None:
    given: dict[str, Any] = {
        "/transport/": {"auth": {"usrpwd": {"user": "a"}}, "shared_memory": {"enabled": True}},
        "metadata": {"name": {"of": "mine"}},
        "scouting/multicast/ttl": 2,
    }
    assert leaves(given) == {
        "transport/auth/usrpwd/user": "a",
        "transport/shared_memory/enabled": True,
        "metadata": {"name": {"of": "mine"}},
        "scouting/multicast/ttl": 2,
    }


@pytest.mark.parametrize(
    ("key", "text", "value"),
    [
        (TTL, "3", 3),
        ("transport/shared_memory/enabled", "true", True),
        ("listen/endpoints", "['tcp/[::]:1', 'udp/x:2',]", ["tcp/[::]:1", "udp/x:2"]),
        (PASSWORD, "secret", "secret"),
        (PASSWORD, "'quoted'", "quoted"),
        (PASSWORD, "1234", "1234"),
        (PASSWORD, "null", None),
    ],
)
def test_what_is_written_on_a_command_line_is_json_where_zenoh_takes_it_and_else_text(
    key: str, text: str, value: object
) -> None:
    assert value_of(key, text, where="--cfg") == value


def test_the_text_of_a_file_stays_text_unless_zenoh_takes_none() -> None:
    assert value_of_file(PASSWORD, "null", where="file") == "null"
    assert value_of_file(TTL, "3", where="file") == 3


def test_an_unknown_key_is_told_with_its_like() -> None:
    for read in (value_of, value_of_file):
        with pytest.raises(ConfigError, match="no key 'scouting/multicast/tll'") as error:
            read("scouting/multicast/tll", "3", where="--cfg")
        assert TTL in str(error.value.hint)


def test_a_refused_value_is_told_without_places_in_zenohs_source() -> None:
    with pytest.raises(ConfigError, match=f"refuses many for '{TTL}'") as error:
        value_of(TTL, "many", where="--cfg")
    assert ".rs:" not in error.value.message
    with pytest.raises(ConfigError) as error:
        value_of_file(TTL, "secret", where="file")
    assert "secret" not in f"{error.value} {error.value.hint}"


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"mode": "client"}, "'mode' cannot be set here"),
        ({"adminspace/enabled": False}, "cannot be set here"),
        ({"scouting/multicast/ttl": "many"}, "Zenoh refuses"),
        ({"nothing": 1}, "Zenoh has no key 'nothing'"),
    ],
)
def test_what_a_segment_cannot_have(config: dict[str, Any], message: str) -> None:
    check_config({TTL: 3, "transport/shared_memory/enabled": True}, where="segment")
    with pytest.raises(ConfigError, match=message):
        check_config(config, where="segment")
