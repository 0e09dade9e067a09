from __future__ import annotations

import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.session import canonical, free_endpoint, prepare_runtime, reason, wait_until
from riot_bus.zenoh.session_config import access_control, client_config, router_config


def test_routers_open_fast_stay_alone_and_time_out_as_told() -> None:
    config = router_config(listen=["tcp/127.0.0.1:0"], wait_before_close_s=0.5, extra={"mode": "peer"})
    assert config["scouting/delay"] == 0
    assert config["scouting/multicast/enabled"] is False
    assert config["transport/link/tx/queue/congestion_control/block/wait_before_close"] == 500_000
    assert config["mode"] == "peer"
    assert client_config("tcp/a:1")["connect/endpoints"] == ["tcp/a:1"]


def test_cut_denies_caches_too_and_applies_to_everybody() -> None:
    rules = access_control(["a/*", "b/**"])["access_control"]
    assert [rule["key_exprs"] for rule in rules["rules"][1:]] == [
        ["a/*", "b/**"],
        ["a/*/@adv/**", "b/**/@adv/**"],
        ["a/*/@adv/pub/**", "b/**/@adv/pub/**"],
    ]
    assert all(rule["permission"] == "deny" and rule["flows"] == ["ingress"] for rule in rules["rules"])
    assert {"query", "reply", "declare_queryable", "declare_subscriber"} <= set(rules["rules"][2]["messages"])
    assert rules["rules"][3]["messages"] == ["liveliness_token"]
    assert not {"query", "reply"} & set(rules["rules"][1]["messages"])
    assert rules["subjects"] == [{"id": "peers"}]
    assert rules["policies"] == [{"rules": ["control", "cut", "cut-caches", "cut-tokens"], "subjects": ["peers"]}]
    assert access_control([], peers=["1a", "2b"])["access_control"]["subjects"] == [
        {"id": "peers", "zids": ["1a", "2b"]}
    ]


def test_questions_to_the_router_never_cross_whatever_is_cut() -> None:
    for cut in ([], ["a"]):
        rule = access_control(cut)["access_control"]["rules"][0]
        assert (rule["key_exprs"], rule["permission"]) == (["@riot/**"], "deny")
        assert "query" in rule["messages"]
        assert "put" not in rule["messages"]  # the junction's own probes


def test_key_expressions_are_canonical_and_unique() -> None:
    assert canonical(["a/**/**", "a/**", "b"]) == ["a/**", "b"]
    with pytest.raises(ConfigError, match="'/a' is not a key expression") as caught:
        canonical(["/a"])
    assert ".rs" not in str(caught.value)


def test_reason_leaves_out_places_in_rust() -> None:
    assert reason(ValueError("no such thing at /root/x/y.rs:12.")) == "no such thing"


def test_free_endpoint_is_an_endpoint() -> None:
    assert free_endpoint().startswith("tcp/127.0.0.1:")


def test_wait_until_gives_up_at_its_deadline() -> None:
    answers = iter([False, True])
    assert wait_until(lambda: next(answers), 5)
    assert not wait_until(lambda: False, 0.01)


def test_runtime_gets_enough_threads_and_respects_the_user(monkeypatch: pytest.MonkeyPatch) -> None:
    from riot_bus.zenoh import session as runtime

    monkeypatch.delenv("ZENOH_RUNTIME", raising=False)
    prepare_runtime()
    assert "rx: (worker_threads: 128)" in runtime.os.environ["ZENOH_RUNTIME"]
    monkeypatch.setenv("ZENOH_RUNTIME", "(rx: (worker_threads: 8))")
    prepare_runtime()
    assert runtime.os.environ["ZENOH_RUNTIME"] == "(rx: (worker_threads: 8))"
    for few, number in (("(tx: (worker_threads: 8))", 2), ("(rx: (worker_threads: 3))", 3)):
        monkeypatch.setenv("ZENOH_RUNTIME", few)
        with pytest.warns(RuntimeWarning, match=f"receive threads per router: {number}"):
            prepare_runtime()


def test_tokens_that_may_cross_are_not_denied() -> None:
    rules = access_control(["a/*", "b"], tokens=["b/@adv/pub/**"])["access_control"]["rules"]
    assert [rule["key_exprs"] for rule in rules if rule["id"] == "cut-tokens"] == [["b/@adv/pub/**"]]
    acl = access_control(["a"], tokens=[])["access_control"]
    assert acl["policies"][0]["rules"] == ["control", "cut", "cut-caches"]


def test_selected_services_are_neither_seen_nor_asked_across() -> None:
    acl = access_control(["a"], services=["calc/*"])["access_control"]
    (rule,) = [each for each in acl["rules"] if each["id"] == "cut-services"]
    assert (rule["key_exprs"], rule["permission"]) == (["calc/*"], "deny")
    assert set(rule["messages"]) == {"query", "reply", "declare_queryable"}
    assert "cut-services" in acl["policies"][0]["rules"]
    assert "cut-services" not in access_control(["a"])["access_control"]["policies"][0]["rules"]
