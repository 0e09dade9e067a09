import pytest

from riot_bus.play.keys import HELP, key_actions


def press(player, key):
    key_actions(player)[key]()


class Player:
    """Notes what it is told."""

    def __init__(self, state="playing", rate=1.0):
        self.told = []
        self.state, self.rate, self.position = state, rate, 30.0

    def status(self):
        return {"state": self.state, "rate": self.rate, "position": self.position, "start": 2.0}

    def set_rate(self, rate):
        self.rate = rate
        self.told.append(("set_rate", rate))

    def __getattr__(self, name):
        return lambda *arguments: self.told.append((name, *arguments))


@pytest.mark.parametrize(
    ("key", "told"),
    [
        (" ", ("pause",)),
        ("s", ("step",)),
        ("right", ("step",)),
        ("up", ("set_rate", 1.1)),
        ("+", ("set_rate", 1.1)),
        ("down", ("set_rate", 0.909)),
        ("-", ("set_rate", 0.909)),
        ("]", ("seek", 40.0)),
        ("[", ("seek", 20.0)),
        ("0", ("seek", 2.0)),
        ("q", ("stop",)),
    ],
)
def test_keys(key, told):
    player = Player()
    press(player, key)
    assert player.told == [told]


def test_space_goes_on_if_it_is_paused():
    player = Player("paused")
    press(player, " ")
    assert player.told == [("resume",)]


def test_faster_and_slower_have_their_ends():
    player = Player()
    for key, end in (("up", 1000.0), ("down", 0.01)):
        for _ in range(200):
            press(player, key)
        assert player.rate == end


def test_as_fast_as_possible_gets_neither_faster_nor_slower():
    player = Player(rate=0.0)
    press(player, "up")
    press(player, "down")
    assert player.told == []


def test_help_names_the_keys():
    for key in ("space", "s or →", "↑ ↓", "[ ]", "0", "q"):
        assert key in HELP


@pytest.mark.parametrize(
    ("rate", "key", "then"),
    [
        (10_000.0, "up", 10_000.0),
        (10_000.0, "down", 9090.0),
        (0.001, "down", 0.001),
        (1e-6, "down", 1e-6),
        (1e-6, "up", 1.1e-6),
    ],
)
def test_a_rate_beyond_what_keys_reach_changes_only_the_way_that_was_asked_for(rate, key, then):
    player = Player(rate=rate)
    press(player, key)
    assert player.rate == then
