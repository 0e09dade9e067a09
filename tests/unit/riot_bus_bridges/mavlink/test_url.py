"""Links as people write them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_bridges.mavlink.url import Direction, Filter, LinkKind, parse_link, parse_links

SERVER, CLIENT = LinkKind.UDP_SERVER, LinkKind.UDP_CLIENT


@pytest.mark.parametrize(
    ("text", "kind", "where"),
    [
        # pymavlink, MAVProxy, dronekit
        ("udpin:0.0.0.0:14550", SERVER, "0.0.0.0:14550"),
        ("udp:127.0.0.1:14550", SERVER, "127.0.0.1:14550"),
        ("udpout:10.0.0.7:14550", CLIENT, "10.0.0.7:14550"),
        ("tcp:127.0.0.1:5760", LinkKind.TCP_CLIENT, "127.0.0.1:5760"),
        ("tcpin:0.0.0.0:5760", LinkKind.TCP_SERVER, "0.0.0.0:5760"),
        ("/dev/ttyACM0,115200", LinkKind.SERIAL, "/dev/ttyACM0:115200"),
        ("/dev/ttyUSB0", LinkKind.SERIAL, "/dev/ttyUSB0:57600"),
        ("logs/flight.tlog", LinkKind.LOG_READER, "logs/flight.tlog"),
        ("/logs/flight.tlog", LinkKind.LOG_READER, "/logs/flight.tlog"),
        ("udpbcast:192.168.1.255:14550", CLIENT, "192.168.1.255:14550"),
        # mavlink-server
        ("udpserver://0.0.0.0:14550", SERVER, "0.0.0.0:14550"),
        ("udps:14550", SERVER, "0.0.0.0:14550"),
        ("udpclient://192.168.2.1:14550?direction=sender", CLIENT, "192.168.2.1:14550"),
        ("udpc:127.0.0.1:1234", CLIENT, "127.0.0.1:1234"),
        ("tcpserver://0.0.0.0:5760", LinkKind.TCP_SERVER, "0.0.0.0:5760"),
        ("tcps:0.0.0.0:5000", LinkKind.TCP_SERVER, "0.0.0.0:5000"),
        ("tcpclient://127.0.0.1:5760", LinkKind.TCP_CLIENT, "127.0.0.1:5760"),
        ("tcpc:10.0.0.1:4000", LinkKind.TCP_CLIENT, "10.0.0.1:4000"),
        ("serial:/dev/ttyACM0:115200", LinkKind.SERIAL, "/dev/ttyACM0:115200"),
        ("serial:///dev/ttyACM0?baudrate=921600", LinkKind.SERIAL, "/dev/ttyACM0:921600"),
        ("tlogreader:///logs/a.tlog", LinkKind.LOG_READER, "/logs/a.tlog"),
        ("tlogwriter://a.tlog", LinkKind.LOG_WRITER, "a.tlog"),
        # MAVSDK
        ("udpin://0.0.0.0:14540", SERVER, "0.0.0.0:14540"),
        ("udp://:14541", SERVER, "0.0.0.0:14541"),
        ("udpout://192.168.1.12:14550", CLIENT, "192.168.1.12:14550"),
        ("tcpin://127.0.0.1:5760", LinkKind.TCP_SERVER, "127.0.0.1:5760"),
        ("tcpout://127.0.0.1:5760", LinkKind.TCP_CLIENT, "127.0.0.1:5760"),
        ("serial:///dev/ttyS1:57600", LinkKind.SERIAL, "/dev/ttyS1:57600"),
        # others
        ("UDPIN:[::1]:14550", SERVER, "[::1]:14550"),
        ("udpout:localhost:14550/", CLIENT, "localhost:14550"),
        ("/dev/ttyS1:1500000", LinkKind.SERIAL, "/dev/ttyS1:1500000"),
    ],
)
def test_spellings(text: str, kind: LinkKind, where: str) -> None:
    found = parse_link(text)
    assert (found.kind, found.where) == (kind, where)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "is not a link"),
        ("14550", "is not a link"),
        ("udpin", "is not a link"),
        ("udpin:", "no port"),
        ("udpin:host", "no port"),
        ("udpin:host:99999", "no port"),
        ("udpin:::1:14550", "not clear"),
        ("udpout::14550", "not an address to connect to"),
        ("udpout:127.0.0.1:0", "not an address to connect to"),
        ("udpin:a b:1", "not a host"),
        ("udpinn:0.0.0.0:1", "did you mean 'udpin'"),
        ("127.0.0.1:14550", "unknown kind of link"),
        ("serial:", "no path"),
        ("serial:/dev/x:0", "not a rate"),
        ("serial:/dev/x?baud=fast", "not a rate"),
        ("udpin:1?name=a/b", "not a name"),
        ("udpin:1?nam=a", "did you mean 'name'"),
        ("udpin:1?name", "cannot read the settings"),
        ("udpin:1?timeout=0", "not a duration"),
        ("udpin:1?rate=x", "not a number"),
        ("udpin:1?direction=up", "unknown direction"),
        ("a.tlog?direction=sender", "a log reader is no sender"),
        ("udpin:1?allow_msg_id_in=NOBODY", "not known"),
        ("udpin:1?allow_src_sys_in=256", "over 255"),
        ("udpin:1?name=a&name=b", "'name' is there twice"),
        ("udpin:1?AllowMsgIdIn=1&allow_msg_id_in=2", "allow_msg_id_in=1,2"),
    ],
)
def test_what_is_wrong_is_named(text: str, part: str) -> None:
    with pytest.raises(ConfigError) as error:
        parse_link(text)
    assert part in str(error.value)


def test_settings() -> None:
    ids = {"HEARTBEAT": 0, "ATTITUDE": 30}
    text = (
        "unit/gcs=udpin:14550?group=radio&direction=receiver&timeout=5&AllowMsgIdIn=HEARTBEAT,30&"
        "BlockSrcSysOut=9&block-src-comp-out=1,2"
    )
    found = parse_link(text, id_of=ids.get)
    assert (found.segment, found.name, found.group) == ("unit", "gcs", "radio")
    assert (found.direction, found.silence, found.text) == (Direction.RECEIVER, 5.0, text)
    assert found.accepts == Filter(allow_msg_id=frozenset({0, 30}))
    assert found.emits == Filter(block_src_sys=frozenset({9}), block_src_comp=frozenset({1, 2}))


def test_links_get_names_and_segments() -> None:
    texts = ["a=udpin:1", "b=udpout:h:1", "b/x=tcp:h:1", "a=/dev/ttyACM0", "a=f/my log.tlog", "a=tcpin:0?name=udp1_3"]
    found = parse_links(texts, segments=["a", "b"])
    assert [each.name for each in found] == ["udp1", "udp1_2", "x", "ttyACM0", "my_log", "udp1_3"]
    assert [each.segment for each in found] == ["a", "b", "b", "a", "a", "a"]
    assert [each.segment for each in parse_links(["udpin:1"], segments=["only"])] == ["only"]
    assert [each.segment for each in parse_links(["udpin:1"])] == [""]
    for wrong, part in (
        (["udpin:1"], "to which segment"),
        (["c=udpin:1"], "no segment 'c'"),
        (["a/x=udpin:1", "b/x=udpin:2"], "several links"),
        (["a=udpin:1"] * 257, "257 links"),
    ):
        with pytest.raises(ConfigError, match=part):
            parse_links(wrong, segments=["a", "b"])


LETTERS = st.sampled_from(
    [*"abz019:/?=&,.[]- _@", "udpin", "tcp", "serial", "://", "?name=", "&group=", ".tlog", "/dev/"]
)


@given(st.one_of(st.text(max_size=80), st.lists(LETTERS, max_size=12).map("".join)))
def test_any_text_is_a_link_or_refused(text: str) -> None:
    try:
        found = parse_link(text)
    except ConfigError:
        return
    assert found.where
    assert found.text == text.strip()


@given(
    st.lists(st.sampled_from(["udpin:1", "udpout:h:1", "tcp:h:1", "/x/udp1", "a.tlog", "/tcp1=udpin:7"]), max_size=9)
)
def test_names_are_unique(texts: list[str]) -> None:
    texts = [text for index, text in enumerate(texts) if "=" not in text or text not in texts[:index]]
    names = [each.name for each in parse_links(texts)]
    assert len(set(names)) == len(texts)
