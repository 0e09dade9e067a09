"""`riot bridge mavlink` between real sockets and real routers."""

from __future__ import annotations

import json
import queue
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import free_endpoint, wait_until
from riot_bus_mavlink.frame import Frame, checksum_fits, parse_frame
from riot_bus_mavlink.tlog import TlogReader, tlog_record
from tests.integration.mavlink_bridge import WAIT_S, MavlinkBridgeProcess, UdpEnd
from tests.integration.router_process import ENVIRONMENT, RIOT, RouterProcess, riot
from tests.unit.riot_bus_bridges.mavlink.frames import COMMON, frame_of, unknown_frame

pytestmark = pytest.mark.integration

VEHICLE, GROUND = (1, 1), (255, 190)


class Bench:
    """An autopilot's and a ground station's socket, with riot between them."""

    def __init__(self, stack: ExitStack, *options: str, router: tuple[str, ...] = ()) -> None:
        self.router = stack.enter_context(RouterProcess(*router))
        self.ground = stack.enter_context(UdpEnd())
        links = ["system/fc=udpin:127.0.0.1:0", f"unit/gcs=udpout:127.0.0.1:{self.ground.port}"]
        self.bridge = stack.enter_context(MavlinkBridgeProcess(self.router.endpoints, links, *options))
        self.vehicle = stack.enter_context(UdpEnd(self.bridge.address("fc")))

    def meet(self) -> None:
        """Send heartbeats until both ends know each other."""
        self.vehicle.send(frame_of(source=VEHICLE, sequence=255).raw)
        assert self.ground.take(1)
        self.ground.send(frame_of(source=GROUND, sequence=255).raw)
        assert self.vehicle.take(1)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as entered:
        yield entered


def test_options_that_are_wrong_are_named(tmp_path: Path) -> None:
    nobody = free_endpoint()
    for arguments, code, part in (
        ([], 2, "--link udpin:0.0.0.0:14550"),
        (["--segment=a", "--endpoint=tcp/127.0.0.1:1"], 2, "--segment"),
        (["--segment=nowhere", "--link=udpin:1"], 2, "nowhere"),
        ([f"--endpoint={nobody}"], 2, "--link udpin:0.0.0.0:14550"),
        ([f"--segment=a={nobody}", f"--segment=a={nobody}", "--link=udpin:1"], 2, "twice"),
        ([f"--endpoint={nobody}", "--link=udpin:1"], 4, "nobody answers"),
    ):
        found, out, err = riot("bridge", "mavlink", *arguments, cwd=tmp_path)
        assert (found, out) == (code, ""), err
        assert part in err


def test_a_port_in_use_is_named(stack: ExitStack) -> None:
    router = stack.enter_context(RouterProcess())
    taken = stack.enter_context(UdpEnd())
    link = f"--link=/x=udpin:127.0.0.1:{taken.port}"
    code, out, err = riot("bridge", "mavlink", f"--endpoint={router.endpoints['unit']}", link)
    assert (code, out) == (4, "")
    assert "cannot listen: Address already in use" in err


@pytest.mark.parametrize("router", [(), ("--intercept=mavlink_raw/**",)], ids=["native", "intercepted"])
def test_frames_cross_as_they_are(stack: ExitStack, router: tuple[str, ...]) -> None:
    bench = Bench(stack, router=router)
    bench.meet()
    telemetry = [frame_of("ATTITUDE", source=VEHICLE, sequence=number, roll=number / 7) for number in range(200)]
    unknown = unknown_frame(source=VEHICLE, sequence=200)
    old = frame_of("PARAM_VALUE", source=VEHICLE, sequence=201, version=1, param_id="RTL_ALT")
    wrong = telemetry[0].raw[:-1] + bytes([telemetry[0].raw[-1] ^ 1])
    bench.vehicle.send(*(frame.raw for frame in telemetry), unknown.raw, b"junk", wrong, old.raw)
    assert bench.ground.take(202) == [*telemetry, unknown, old]
    for target, arrives in (((1, 1), True), ((1, 0), True), ((0, 0), True), ((42, 1), False), ((1, 100), False)):
        command = frame_of("COMMAND_LONG", source=GROUND, target=target, command=400)
        bench.ground.send(command.raw, frame_of("SYSTEM_TIME", source=GROUND).raw)
        found = bench.vehicle.take(2 if arrives else 1)
        assert [frame.message_id for frame in found] == [76, 2][not arrives :]
    assert bench.ground.get(0.2) is None  # nothing comes back
    status = bench.bridge.end()
    vehicle, ground = status["links"]["fc"], status["links"]["gcs"]
    assert (vehicle["in"], vehicle["bad_crc"], vehicle["unknown"]) == (203, 1, 1)
    assert vehicle["bytes"] == vehicle["frame_bytes"] + vehicle["junk_bytes"]
    assert vehicle["junk_bytes"] == len(b"junk") + len(wrong)
    assert vehicle["sources"] == {"1/1": {"received": 203, "lost": 0}}
    assert (ground["in"], ground["out"], vehicle["out"]) == (11, 203, 9)
    assert status["segments"]["unit"] == {
        "endpoint": bench.router.endpoints["unit"],
        "from_bus": 203,
        "to_bus": 11,
    }
    assert status["segments"]["system"]["unrouted"] == 2


def test_fields_are_injected(stack: ExitStack, tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(
        '[[inject]]\ntopic = "mavlink_raw/fc/1/1/ATTITUDE"\nfield = "roll"\nvalue = nan\n'
        '[[inject]]\ntopic = "mavlink_raw/gcs/*/*/COMMAND_LONG"\nfield = "param1"\nvalue = 7.0\n'
    )
    bench = Bench(stack, router=(f"--inject={plan}",))
    bench.meet()
    sent = frame_of("ATTITUDE", source=VEHICLE, sequence=3, roll=1.0, pitch=2.0)
    bench.vehicle.send(sent.raw)
    (found,) = bench.ground.take(1)
    assert found == frame_of("ATTITUDE", source=VEHICLE, sequence=3, roll=float("nan"), pitch=2.0)
    bench.ground.send(frame_of("COMMAND_LONG", source=GROUND, target=VEHICLE, command=400, param1=1.0).raw)
    (command,) = bench.vehicle.take(1)
    assert command == frame_of("COMMAND_LONG", source=GROUND, target=VEHICLE, command=400, param1=7.0)
    extra = COMMON.crc_extra(76)
    assert extra is not None
    assert checksum_fits(command, extra)


def test_links_of_one_segment_need_no_riot_between_them(stack: ExitStack) -> None:
    router = stack.enter_context(RouterProcess())
    ground, other = stack.enter_context(UdpEnd()), stack.enter_context(UdpEnd())
    links = [
        "/fc=tcpin:127.0.0.1:0",
        f"/gcs=udpout:127.0.0.1:{ground.port}?block_msg_id_out=ATTITUDE",
        f"/other=udpout:127.0.0.1:{other.port}?allow_src_sys_out=2",
    ]
    bridge = stack.enter_context(MavlinkBridgeProcess({"unit": router.endpoints["unit"]}, links))
    with socket.create_connection(bridge.address("fc"), timeout=WAIT_S) as vehicle:
        frames = [frame_of(source=VEHICLE, sequence=0), frame_of("ATTITUDE", source=VEHICLE, sequence=1)]
        frames += [frame_of("SYS_STATUS", source=VEHICLE, sequence=2), frame_of(source=(2, 1))]
        stream = b"".join(frame.raw for frame in frames)
        for byte in range(0, len(stream), 5):
            vehicle.sendall(stream[byte : byte + 5])
        assert ground.take(3) == [frames[0], frames[2], frames[3]]
        assert other.take(1) == [frames[3]]
    status = bridge.end()
    assert status["segments"]["unit"] == {"endpoint": router.endpoints["unit"], "to_bus": 4}
    assert status["links"]["gcs"]["filtered_out"] == 1
    assert status["links"]["other"]["filtered_out"] == 3


def test_what_is_inserted_has_numbers_of_its_own(stack: ExitStack) -> None:
    bench = Bench(stack)
    bench.meet()
    client = open_client(bench.router.endpoints["unit"])
    stack.callback(client.close)
    key = "mavlink_raw/tester/1/1/STATUSTEXT"
    client.declare(key, Qos(congestion="block"))
    inserted = frame_of("STATUSTEXT", source=VEHICLE, sequence=99, severity=2, text="inserted")
    for _ in range(3):
        client.put(Message(0, key, inserted.raw, qos=Qos(congestion="block")))
    found = bench.ground.take(3)
    assert [frame.sequence for frame in found] == [0, 1, 2]
    assert {frame.payload for frame in found} == {inserted.payload}
    bench.vehicle.send(frame_of(source=VEHICLE, sequence=0).raw)
    assert [frame.sequence for frame in bench.ground.take(1)] == [0]
    assert bench.bridge.end()["segments"]["unit"]["inserted"] == 3


def test_json_goes_both_ways(stack: ExitStack) -> None:
    bench = Bench(stack, "--mirror=fields")
    client = open_client(bench.router.endpoints["unit"])
    stack.callback(client.close)
    heard: queue.Queue[Message] = queue.Queue()
    client.subscribe("mavlink/**", heard.put)
    seen: dict[str, Any] = {}

    def mirrored() -> bool:
        bench.vehicle.send(frame_of(source=VEHICLE, type=2, base_mode=81).raw)
        while not heard.empty():
            message = heard.get()
            seen[message.key] = json.loads(message.payload)
            assert message.encoding == "application/json;mavlink"
        return len(seen) >= 9

    assert wait_until(mirrored, WAIT_S, interval=0.05), seen
    assert seen["mavlink/1/1/HEARTBEAT"]["message"]["mavtype"] == {"type": "MAV_TYPE_QUADROTOR"}
    assert seen["mavlink/out"] == seen["mavlink/1/1/HEARTBEAT"]
    assert seen["mavlink/1/1/HEARTBEAT/base_mode"] == {"bits": 81}
    command = {
        "header": {"system_id": 255, "component_id": 1, "sequence": 0},
        "message": {
            "type": "COMMAND_LONG",
            "target_system": 1,
            "target_component": 1,
            "command": {"type": "MAV_CMD_NAV_LAND"},
        },
    }
    client.put(Message(0, "mavlink/in", b"{", qos=Qos(congestion="block")))
    client.put(Message(0, "mavlink/in", json.dumps(command).encode(), qos=Qos(congestion="block")))
    (found,) = bench.vehicle.take(1)
    assert found == frame_of("COMMAND_LONG", source=(255, 1), target=VEHICLE, command=21)
    status = bench.bridge.end()["segments"]["system"]
    assert (status["json_in"], status["json_refused"]) == (1, 1)


def test_frames_are_raw_on_the_bus(stack: ExitStack) -> None:
    bench = Bench(stack, "--keys=robot/{MESSAGE}/{sysid}")
    client = open_client(bench.router.endpoints["unit"])
    stack.callback(client.close)
    heard: queue.Queue[Message] = queue.Queue()
    bell = threading.Event()
    client.subscribe("robot/**", lambda message: (heard.put(message), bell.set()))  # type: ignore[func-returns-value]
    sent = frame_of(source=VEHICLE)

    def arrived() -> bool:
        bench.vehicle.send(sent.raw)
        return bell.wait(0.05)

    assert wait_until(arrived, WAIT_S)
    message = heard.get()
    assert (message.key, message.payload) == ("robot/HEARTBEAT/1", sent.raw)
    assert message.encoding == "application/octet-stream;mavlink"
    assert parse_frame(message.payload) == sent


def test_it_says_what_it_does(stack: ExitStack) -> None:
    router = stack.enter_context(RouterProcess())
    unit = router.endpoints["unit"]
    process = stack.enter_context(
        subprocess.Popen(
            [
                *RIOT,
                "bridge",
                "mavlink",
                f"--endpoint={unit}",
                "--link=/fc=udpin:127.0.0.1:0",
                "--link=tcp:127.0.0.1:1",
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=ENVIRONMENT,
        )
    )
    stack.callback(process.kill)
    assert process.stdout is not None
    assert process.stderr is not None
    line = process.stdout.readline()
    assert line.startswith("ready: fc (udp server 127.0.0.1:")
    assert line.endswith(f", tcp1 (tcp client 127.0.0.1:1) and the segment ({unit})\n")
    assert process.stderr.readline() == "warning: tcp1 (127.0.0.1:1): Connection refused; it is tried again\n"
    port = int(line.partition("127.0.0.1:")[2].partition(")")[0])
    with UdpEnd(("127.0.0.1", port)) as vehicle:
        frames: list[Frame] = [frame_of(sequence=0), frame_of(sequence=5)]
        vehicle.send(*(frame.raw for frame in frames))
        client = open_client(unit)
        stack.callback(client.close)
        bell = threading.Event()
        client.subscribe("mavlink_raw/**", lambda message: bell.set())

        def arrived() -> bool:
            vehicle.send(frame_of(source=(9, 9)).raw)
            return bell.wait(0.05)

        assert wait_until(arrived, WAIT_S)
    process.terminate()
    out, _ = process.communicate(timeout=60)
    rows = [row.split() for row in out.splitlines()]
    assert process.returncode == 0
    assert out.startswith("segment: ")
    (row,) = [row for row in rows if row[0] == "fc"]
    assert (int(row[1]) > 2, row[3]) == (True, "4") or int(row[3]) >= 4


def test_init_writes_a_system_file_from_a_live_link(stack: ExitStack, tmp_path: Path) -> None:
    with UdpEnd() as probe:
        port = probe.port
    vehicle = stack.enter_context(UdpEnd(("127.0.0.1", port)))
    ended = threading.Event()

    def talk() -> None:
        while not ended.wait(0.05):
            vehicle.send(frame_of(source=VEHICLE, type=2, autopilot=3).raw, frame_of("ATTITUDE", source=VEHICLE).raw)

    talking = threading.Thread(target=talk)
    talking.start()
    stack.callback(talking.join)
    stack.callback(ended.set)
    link = f"--mavlink=/fc=udpin:127.0.0.1:{port}"
    code, out, err = riot("init", link, "--seconds=1", cwd=tmp_path)
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        "fc  outside  2 topics  1/1 (QUADROTOR, ARDUPILOTMEGA)",
        "unit  inside  0 topics  not heard",
        "written: riot.toml; next, fill in what it marks with FILL IN, above all the commands",
    ]
    assert 'inputs = [\n    "mavlink_raw/fc/1/1/ATTITUDE",\n' in (tmp_path / "riot.toml").read_text()
    code, _, err = riot("init", link, cwd=tmp_path)
    assert (code, "there is a system file already" in err) == (2, True)
    code, _, err = riot("init", "--mavlink=udpin:127.0.0.1:0", "--ros2", cwd=tmp_path)
    assert (code, "--ros2 and --mavlink do not go together" in err) == (2, True)


def test_a_segment_is_listened_to_when_the_program_behind_is_connected(stack: ExitStack, tmp_path: Path) -> None:
    router = stack.enter_context(RouterProcess())
    unit = router.endpoints["unit"]
    client = open_client(unit)
    stack.callback(client.close)
    go = tmp_path / "go"
    program = (
        "import pathlib, socket, sys, time\n"
        f"while not pathlib.Path({str(go)!r}).exists(): time.sleep(0.01)\n"
        "made = socket.create_connection(('127.0.0.1', int(sys.argv[1])))\n"
        "print('got', made.recv(300).hex(), flush=True)\n"
        "sys.exit(7)\n"
    )
    process = stack.enter_context(
        subprocess.Popen(
            [
                *RIOT,
                *("bridge", "mavlink", f"--endpoint={unit}", "--link=/x=tcpin:127.0.0.1:0"),
                f"--link=tlogwriter:{tmp_path / 'all.tlog'}",  # nobody waits for a log
                *("--", sys.executable, "-c", program, "{port}"),
            ],
            stdout=subprocess.PIPE,
            text=True,
            env=ENVIRONMENT,
        )
    )
    stack.callback(process.kill)
    assert process.stdout is not None
    assert process.stdout.readline().startswith("ready: ")
    key = "mavlink_raw/tester/1/1/HEARTBEAT"
    publisher = client.session.declare_publisher(key)
    assert not publisher.matching_status.matching
    go.touch()
    assert wait_until(lambda: bool(publisher.matching_status.matching), WAIT_S)
    publisher.put(frame_of(sequence=5).raw)
    assert process.stdout.readline() == f"got {frame_of(sequence=5).raw.hex()}\n"
    assert process.wait(timeout=WAIT_S) == 7


def test_it_goes_on_with_a_router_that_was_killed_and_started_again(stack: ExitStack) -> None:
    first = stack.enter_context(RouterProcess())
    ground = stack.enter_context(UdpEnd())
    links = ["system/fc=udpin:127.0.0.1:0", f"unit/gcs=udpout:127.0.0.1:{ground.port}"]
    bridge = stack.enter_context(MavlinkBridgeProcess(first.endpoints, links))
    vehicle = stack.enter_context(UdpEnd(bridge.address("fc")))

    def crossed() -> bool:
        vehicle.send(frame_of(source=VEHICLE).raw)
        return ground.get(0.1) is not None

    assert wait_until(crossed, WAIT_S)
    first.process.kill()
    first.process.wait()
    while ground.get(1.0) is not None:
        pass  # it was sent before
    assert not crossed()
    stack.enter_context(RouterProcess(endpoints=first.endpoints))
    assert wait_until(crossed, 60)
    bridge.end()


def test_parallel_links_are_one(stack: ExitStack) -> None:
    router = stack.enter_context(RouterProcess())
    ground = stack.enter_context(UdpEnd())
    links = [
        "system/lte=udpin:127.0.0.1:0?group=air",
        "system/radio=udpin:127.0.0.1:0?group=air",
        f"unit/gcs=udpout:127.0.0.1:{ground.port}",
    ]
    bridge = stack.enter_context(MavlinkBridgeProcess(router.endpoints, links, "--duplicates=5"))
    lte, radio = (stack.enter_context(UdpEnd(bridge.address(name))) for name in ("lte", "radio"))
    frames = [frame_of("ATTITUDE", source=VEHICLE, sequence=number) for number in range(20)]
    for number, frame in enumerate(frames):
        lte.send(frame.raw)
        if number % 3:
            radio.send(frame.raw)
    assert {frame.sequence for frame in ground.take(20)} == set(range(20))
    command = frame_of("COMMAND_LONG", source=GROUND, target=VEHICLE)
    ground.send(command.raw)
    assert (lte.take(1), radio.take(1)) == ([command], [command])
    assert ground.get(0.2) is None
    status = bridge.end()["links"]
    assert status["lte"].get("duplicate", 0) + status["radio"].get("duplicate", 0) == 13


def test_a_log_is_played_through_riot_into_another_log(stack: ExitStack, tmp_path: Path) -> None:
    frames = [frame_of("ATTITUDE", source=VEHICLE, sequence=number % 256, yaw=number) for number in range(3000)]
    source, sink = tmp_path / "in.tlog", tmp_path / "out.tlog"
    source.write_bytes(b"".join(tlog_record(10**18 + number, frame.raw) for number, frame in enumerate(frames)))
    router = stack.enter_context(RouterProcess())
    links = [f"system={source}?rate=0", f"unit/sink=tlogwriter:{sink}"]
    bridge = stack.enter_context(MavlinkBridgeProcess(router.endpoints, links))
    assert wait_until(lambda: sink.stat().st_size >= source.stat().st_size, WAIT_S, interval=0.1)
    status = bridge.end()
    reader = TlogReader(COMMON.crc_extra)
    assert [record.frame for record in [*reader.feed(sink.read_bytes()), *reader.flush()]] == frames
    assert status["links"]["in"]["sources"] == {"1/1": {"received": 3000, "lost": 0}}
    assert status["links"]["in"]["state"] == "ended"
    assert status["segments"]["unit"]["from_bus"] == 3000
