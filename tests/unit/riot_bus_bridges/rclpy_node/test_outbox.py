import socket
import threading

import pytest

from riot_bus_bridges.rclpy_node import outbox
from riot_bus_bridges.rclpy_node.outbox import Outbox

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
