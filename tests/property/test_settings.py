import json
import shlex

from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.config.endpoints import PROTOCOLS, overlap, parse_endpoint, split_endpoints
from riot_bus.control.environment import client_settings, environment_lines, override, session_file
from riot_bus.control.router_options import parse_cfg, parse_endpoints
from riot_bus.vocabulary.errors import ConfigError
from tests.tiers import scaled

words = st.text("abz019._-=,;:?#/ '\"|é", max_size=12).map(str.strip)
hosts = st.sampled_from(["127.0.0.1", "0.0.0.0", "localhost", "robot.local", "[::1]", "[::]", "[fe80::1]"])
addresses = st.builds("{}:{}".format, hosts, st.integers(1, 65535))
names = st.from_regex(r"[A-Za-z0-9_][A-Za-z0-9_.-]*", fullmatch=True)


def separated(text: str) -> bool:
    """Whether a comma in the text would be taken for one between endpoints."""
    return len(split_endpoints("tcp/a:1#" + text)) > 1 or text.endswith(",")


@st.composite
def endpoints(draw) -> str:
    protocol = draw(st.sampled_from(PROTOCOLS))
    if protocol == "unixsock-stream":
        address = "/" + draw(st.text("abc/._-=;:", min_size=1, max_size=20))
    else:
        address = draw(addresses)
    metadata = draw(st.just("") | st.sampled_from(["rel=1", "prio=6-7;rel=0"]))
    config = draw(st.just("") | words.filter(lambda text: not separated(text)))
    return f"{protocol}/{address}" + (f"?{metadata}" if metadata else "") + (f"#{config}" if config else "")


@given(endpoints())
def test_an_endpoint_comes_back_as_it_was_written(text):
    assert str(parse_endpoint(text)) == text
    assert overlap(parse_endpoint(text), parse_endpoint(text))


@given(names, st.lists(endpoints(), min_size=1, max_size=4), st.sampled_from([",", ", ", ",  "]))
def test_endpoints_survive_the_command_line(name, texts, comma):
    assert parse_endpoints([f"{name}={comma.join(texts)}"], where="--segment") == {name: tuple(texts)}
    one_by_one = parse_endpoints([f"{name}={text}" for text in texts], where="--segment")
    assert one_by_one == {name: tuple(texts)}


@given(st.text(max_size=40) | st.builds("{}/{}".format, st.sampled_from(PROTOCOLS), st.text(max_size=30)))
def test_any_text_is_an_endpoint_or_a_clear_error(text):
    try:
        endpoint = parse_endpoint(text)
    except ConfigError as error:
        refused = error
    else:
        refused = None
        assert parse_endpoint(str(endpoint)) == endpoint
        assert 0 <= endpoint.port <= 65535
    assert refused is None or refused.hint


@given(names, st.from_regex(r"[a-z_]+(/[a-z_]+)*", fullmatch=True), st.text())
def test_settings_survive_the_command_line(name, key, value):
    assert parse_cfg(f"{name}:{key}={value}") == (name, key, value)


@given(st.lists(endpoints(), min_size=1, max_size=3), st.text())
@settings(max_examples=scaled(50))
def test_what_rmw_zenoh_reads_is_what_was_meant(texts, password):
    meant = client_settings(texts, {"transport/auth/usrpwd/password": password})
    pairs = [pair.split("=", 1) for pair in override(meant).split(";")]
    assert {key: json.loads(value) for key, value in pairs} == meant


@given(st.lists(endpoints(), min_size=1, max_size=3))
@settings(max_examples=scaled(50))
def test_a_shell_reads_what_was_meant(texts):
    _, implementation, line = environment_lines("unit", texts, "rmw_zenoh")
    assert implementation == "export RMW_IMPLEMENTATION=rmw_zenoh_cpp"
    assert shlex.split(line)[1] == f"ZENOH_CONFIG_OVERRIDE={override(client_settings(texts))}"


@given(st.lists(endpoints(), min_size=1, max_size=3), st.text())
@settings(max_examples=scaled(50))
def test_a_session_file_holds_every_setting(texts, password):
    tree = json.loads(session_file(client_settings(texts, {"transport/auth/usrpwd/password": password})))
    assert tree["connect"]["endpoints"] == texts
    assert tree["transport"]["auth"]["usrpwd"]["password"] == password
    assert tree["scouting"]["multicast"]["enabled"] is False
