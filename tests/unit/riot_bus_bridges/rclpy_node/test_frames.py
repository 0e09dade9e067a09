import socket
import threading

import pytest

from riot_bus_bridges.rclpy_node.frames import BridgeFrameKind, Wire


@pytest.fixture
def wires():
    pair = [Wire(each) for each in socket.socketpair()]
    yield pair
    for wire in pair:
        wire.close()


def test_frames_of_all_sizes_arrive_in_their_order(wires):
    one, other = wires
    payloads = [b"", b"x", b"y" * (1 << 16), b"z" * 5_000_000, b"end"]

    def send():
        for number, payload in enumerate(payloads):
            one.send(BridgeFrameKind.MESSAGE, number, number - 1, payload)
        one.tell({"do": "drop", "id": 7, "topic": "/ä"})

    thread = threading.Thread(target=send)
    thread.start()
    for number, payload in enumerate(payloads):
        assert other.receive() == (BridgeFrameKind.MESSAGE, number, number - 1, payload)
    frame = other.receive()
    thread.join()
    assert frame is not None
    assert (frame.kind, frame.document()) == (BridgeFrameKind.DOCUMENT, {"do": "drop", "id": 7, "topic": "/ä"})


def test_the_end_of_one_is_the_end_of_the_other(wires):
    one, other = wires
    one.send(BridgeFrameKind.MESSAGE, 1, 2, b"last")
    one.hang_up()
    one.hang_up()
    assert other.receive() == (BridgeFrameKind.MESSAGE, 1, 2, b"last")
    assert other.receive() is None
    assert one.receive() is None
    with pytest.raises(OSError):  # noqa: PT011 - which one depends on the system
        one.send(BridgeFrameKind.MESSAGE, 1, 2, b"more")


@pytest.mark.parametrize("kept", [1, 16, 17, 20])
def test_half_a_frame_is_none(kept):
    ours, theirs = socket.socketpair()
    writer, reader = Wire(ours), Wire(theirs)
    writer.send(BridgeFrameKind.MESSAGE, 1, 2, b"payload")
    whole = theirs.recv(100)
    again, end = socket.socketpair()
    again.sendall(whole[:kept])
    again.close()
    broken = Wire(end)
    assert broken.receive() is None
    for wire in (writer, reader, broken):
        wire.close()


def test_many_threads_may_send(wires):
    one, other = wires
    threads = [
        threading.Thread(
            target=lambda n=n: [one.send(BridgeFrameKind.MESSAGE, n, each, bytes(each)) for each in range(200)]
        )
        for n in range(4)
    ]
    for thread in threads:
        thread.start()
    found = {n: [] for n in range(4)}
    for _ in range(800):
        frame = other.receive()
        assert len(frame.payload) == frame.number
        found[frame.endpoint].append(frame.number)
    for thread in threads:
        thread.join()
    assert found == {n: list(range(200)) for n in range(4)}
