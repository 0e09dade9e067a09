from __future__ import annotations

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from riot_bus.types.capabilities import HasServices
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.types.serve import ERROR, PARTS, REPLY, REQUEST, Request, part_of
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.vocabulary.selector import key_matches

HASH = "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
ADD = f"0/add/example_interfaces::srv::dds_::AddTwoInts_/{HASH}"
calmly = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])  # machines may be busy
KEYS = st.lists(st.text("ab*$@", min_size=1, max_size=3), min_size=1, max_size=4).map("/".join)


@calmly
@given(KEYS, st.sampled_from(PARTS))
def test_a_part_is_found_again(key: str, part: str) -> None:
    assert part_of(f"{key}/{part}") == (key, part)


@calmly
@given(st.text("a/@requstply*", max_size=12))
def test_other_keys_have_no_part(key: str) -> None:
    found = part_of(key)
    assert found is None or (f"{found[0]}/{found[1]}" == key and found[1] in PARTS)


def test_names_that_only_look_like_it_are_topics() -> None:
    for key in ("", "@request", "a@request", "a/@requests", "a/@request/b", "a/@REQUEST"):
        assert part_of(key) is None


def test_wildcards_do_not_mean_calls() -> None:
    for part in PARTS:
        assert not key_matches("**", f"calc/add/{part}")
        assert not key_matches("calc/*/*", f"calc/add/{part}")
        assert key_matches(f"calc/**/{part}", f"calc/add/{part}")


def test_a_changed_request_keeps_its_parameters() -> None:
    request = Request(1, "k/@request", b"a", attachment=b"x", qos=Qos(1), sequence=7, parameters="p=1")
    changed = request.with_payload(b"b")
    assert changed == Request(1, "k/@request", b"b", attachment=b"x", qos=Qos(1), sequence=7, parameters="p=1")
    assert request != Message(1, "k/@request", b"a", attachment=b"x", qos=Qos(1), sequence=7)


def test_calls_have_names_and_types_of_their_service() -> None:
    registry = TypeRegistry(load_adapters(["ros2"]))
    types = {REQUEST: "example_interfaces/srv/AddTwoInts_Request", REPLY: "example_interfaces/srv/AddTwoInts_Response"}
    for part in PARTS:
        key = f"{ADD}/{part}"
        assert registry.topic(key) == f"/add/{part}"
        found = registry.type_of(key)
        assert (None if found is None else found.name) == types.get(part)
        assert registry.matches(f"/add/{part}", key)
        assert not registry.matches("/add", key)
        assert not registry.matches(f"/other/{part}", key)
        assert key_matches(registry.key_expression(f"/add/{part}"), key)
    assert not registry.matches(f"/add/{REQUEST}", f"{ADD}/{ERROR}")


def test_requests_of_a_service_with_another_definition_are_opaque() -> None:
    registry = TypeRegistry(load_adapters(["ros2"]))
    found = registry.type_of(f"{ADD.replace(HASH, 'RIHS01_' + '0' * 64)}/{REQUEST}")
    assert found is not None
    assert "another one than the key's" in str(found.opaque(bytes(20)))
    humble = registry.type_of(f"{ADD.replace(HASH, 'TypeHashNotSupported')}/{REQUEST}")
    assert humble is not None
    assert humble.read(b"\0\1\0\0" + (5).to_bytes(8, "little") * 2, "a") == 5


def test_without_adapters_names_are_keys() -> None:
    registry = TypeRegistry()
    assert registry.topic("calc/add/@reply") == "calc/add/@reply"
    assert registry.key_expression("calc/*/@reply") == "calc/*/@reply"
    assert registry.service_adapters() == []
    found = registry.type_of("calc/add/@request", payload=b'{"a": 1}')
    assert found is not None
    assert found.read(b'{"a": 1}', "a") == 1


def test_the_adapter_for_ros_knows_services_and_actions() -> None:
    (ros,) = load_adapters(["ros2"])
    assert isinstance(ros, HasServices)
    assert ros.action_parts("/fibonacci") == "/fibonacci/_action/*"
    assert ros.action_parts("no/name") is None
    assert ros.call_type("a/srv/B", ERROR) is None
    assert ros.call_type("no_type", REQUEST) is None
