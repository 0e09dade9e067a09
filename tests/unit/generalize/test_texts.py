import random

from riot_bus.generalize.texts import LONGEST, resized, varied


def test_resized_texts_keep_their_begin() -> None:
    assert resized("map", 2) == "ma"
    assert resized("map", 7) == "mapmapm"
    assert resized("", 3) == "aaa"
    assert resized(b"\0", 3) == b"\0\0\0"
    assert resized("map", 0) == ""


def test_variations_differ_in_length_begin_and_alphabet_and_are_bounded() -> None:
    chance = random.Random(1)
    texts = [varied(["map", "/odom"], chance) for _ in range(2000)]
    assert max(map(len, texts)) > 256
    assert max(map(len, texts)) <= LONGEST
    assert {"", "map"} & set(texts)
    assert any(not text.isascii() for text in texts)
    assert any(text.startswith("/") and text != "/odom" for text in texts)
    assert len(set(texts)) > 1000
    assert all(isinstance(some, bytes) for some in (varied([b"\0"], chance) for _ in range(50)))
