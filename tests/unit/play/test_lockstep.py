"""Lock-step without a network: what comes on the watched keys is handed in by the test."""

from __future__ import annotations

import threading

import pytest

from riot_bus.play.lockstep import Acknowledged, Quiet
from riot_bus.vocabulary.errors import ConfigError


class Session:
    """Keeps what is declared; `come` is a message that arrives."""

    def __init__(self):
        self.keys, self.callbacks = [], []

    def declare_subscriber(self, key, callback, **settings):
        self.keys.append(key)
        self.callbacks.append(callback)
        return self

    def undeclare(self):
        self.callbacks.pop()

    def come(self):
        self.callbacks[0](None)


def never():
    return False


def test_an_acknowledgement_after_the_message_counts():
    session = Session()
    settling = Acknowledged(session, ["ack"], timeout=30.0)
    settling.sent()
    threading.Timer(0.01, session.come).start()
    assert settling.wait(never)
    assert settling.unsettled == 0


def test_an_acknowledgement_that_came_before_does_not():
    session = Session()
    settling = Acknowledged(session, ["ack"], timeout=0.01)
    session.come()
    settling.sent()
    assert not settling.wait(never)
    assert settling.unsettled == 1


def test_an_acknowledgement_between_sending_and_waiting_counts():
    session = Session()
    settling = Acknowledged(session, ["ack"], timeout=0.0)
    settling.sent()
    session.come()
    assert settling.wait(never)


def test_giving_up_is_not_counted():
    settling = Acknowledged(Session(), ["ack"], timeout=30.0)
    settling.sent()
    assert not settling.wait(lambda: True)
    assert settling.unsettled == 0


def test_quiet_after_a_while_without_messages():
    settling = Quiet(Session(), ["out/*"], window=0.01, timeout=30.0)
    settling.sent()
    assert settling.wait(never)


def test_it_is_not_quiet_while_messages_come():
    session = Session()
    settling = Quiet(session, ["out/*"], window=0.5, timeout=1.5)
    ended = threading.Event()

    def chatter():
        while not ended.wait(0.001):
            session.come()

    thread = threading.Thread(target=chatter)
    settling.sent()
    thread.start()
    assert not settling.wait(never)
    assert settling.unsettled == 1
    ended.set()
    thread.join()
    assert settling.wait(never)


def test_keys_are_watched_until_it_is_closed():
    session = Session()
    settling = Quiet(session, ["out/**/**", "b"], window=0.0, timeout=1.0)
    assert session.keys == ["out/**", "b"]
    settling.close()
    assert session.callbacks == []
    with pytest.raises(ConfigError, match="not a key expression"):
        Quiet(session, ["/out"], window=0.0, timeout=1.0)
