from riot_bus.interceptors.per_topic import PerTopic


def test_what_was_not_set_for_longest_is_forgotten():
    states = PerTopic(most=3)
    for topic in "abc":
        states[topic] = 1
    states["a"] = 2
    states["d"] = 1
    assert [states.get(topic) for topic in "abcd"] == [2, None, 1, 1]
    assert len(states) == 3


def test_sizes_are_bounded_but_one_state_always_fits():
    states = PerTopic(most=10, size=len)
    states["a"] = b"1234"
    states["b"] = b"1234"
    states["a"] = b"123456"
    assert (states.get("a"), states.get("b")) == (b"123456", b"1234")
    states["c"] = bytes(100)
    assert len(states) == 1
    assert states.get("c") == bytes(100)
