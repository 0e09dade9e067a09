import socket
import threading

import pytest

from riot_bus_bridges.rclpy_node import frames as outbox
from riot_bus_bridges.rclpy_node.frames import BridgeFrameKind, Outbox, Wire


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


WAIT_S = 20


@pytest.fixture
def ends():
    ours, theirs = socket.socketpair()
    theirs.settimeout(WAIT_S)
    box = Outbox(ours)
    yield box, theirs
    ours.shutdown(socket.SHUT_RDWR)
    box.close()
    for each in (ours, theirs):
        each.close()


def read(end, size):
    found = b""
    while len(found) < size:
        data = end.recv(1 << 20)
        assert data
        found += data
    return found


def fill(box):
    """Hand in more than the socket takes; return what."""
    pieces = [bytes([number]) * 100_000 for number in range(50)]
    for each in pieces:
        box.put(each)
    assert not box.flush(0.01)
    return b"".join(pieces)


def test_what_the_socket_takes_is_there_at_once(ends):
    box, end = ends
    box.put(b"a", b"", b"bc")
    assert box.flush(0)
    assert end.recv(10) == b"abc"


def test_what_it_does_not_take_waits_and_keeps_its_order(ends):
    box, end = ends
    expected = fill(box)
    box.put(b"last ", b"words")
    assert read(end, len(expected) + 10) == expected + b"last words"
    assert box.flush(WAIT_S)
    box.put(b"more")
    assert end.recv(10) == b"more"


def test_who_hands_in_too_much_waits_unless_he_must_not(ends, monkeypatch):
    box, end = ends
    monkeypatch.setattr(outbox, "_ROOM", 1000)
    box.put(bytes(1 << 20))
    done = threading.Event()

    def wait():
        box.put(b"x" * 100)
        done.set()

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    box.put(b"y" * 100, patient=False)
    assert not done.is_set()
    found = read(end, (1 << 20) + 200)
    assert done.wait(WAIT_S)
    thread.join()
    assert found[1 << 20 :] == b"y" * 100 + b"x" * 100
    assert box.flush(WAIT_S)


def test_one_message_may_be_larger_than_all_the_room(ends, monkeypatch):
    box, end = ends
    monkeypatch.setattr(outbox, "_ROOM", 1000)
    payload = bytes(range(256)) * 10_000
    thread = threading.Thread(target=lambda: [box.put(payload) for _ in range(3)])
    thread.start()
    assert read(end, 3 * len(payload)) == 3 * payload
    thread.join(WAIT_S)
    assert not thread.is_alive()


def test_the_end_frees_who_waits_and_takes_no_more(ends, monkeypatch):
    box, end = ends
    monkeypatch.setattr(outbox, "_ROOM", 1000)
    box.put(bytes(1 << 20))
    failures = []

    def wait():
        try:
            box.put(bytes(100))
        except OSError as error:
            failures.append(error)

    thread = threading.Thread(target=wait)
    thread.start()
    end.close()
    thread.join(WAIT_S)
    assert len(failures) == 1
    with pytest.raises(OSError, match="gone"):
        box.put(b"x")
    assert not box.flush(0)
