from __future__ import annotations

from riot_bus.config.router_settings import RouterSettings, SegmentSettings
from riot_bus.control.exposure import exposure_warnings


def test_a_listener_that_is_open_to_the_network_is_named_without_its_configuration() -> None:
    segment = SegmentSettings(listen=("tcp/0.0.0.0:7447#iface=secret", "tcp/127.0.0.1:7448", "tls/0.0.0.0:7449"))
    (line,) = exposure_warnings(RouterSettings(segments={"a": segment}))
    assert line.startswith("segment 'a' listens on tcp/0.0.0.0:7447#...: any host that reaches it")


def test_users_and_access_control_are_a_choice_that_was_made() -> None:
    for config in ({"transport/auth/usrpwd/dictionary_file": "users"}, {"access_control/enabled": True}):
        segment = SegmentSettings(listen=("tcp/0.0.0.0:7447",), config=config)
        assert exposure_warnings(RouterSettings(segments={"a": segment})) == []
