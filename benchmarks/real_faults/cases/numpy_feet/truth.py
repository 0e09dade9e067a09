"""Fails if a quartile lies between two counts (in order) that are more than 32767 apart."""

import math

from changes import changed, drawn, near, near_integer


def nominal():
    """Walks: one foot of four is in the air, where springs pull at its gauge."""
    bias = 0
    for i in range(80):
        if i % 16 == 0:
            bias = 20 + 3 * i
            yield i * 0.05, "tare", {"bias": bias, "celsius": 24.0 + 0.02 * i}
        counts = [14200 + bias + int(700 * math.sin(i / 5 + k)) + (37 * i + 11 * k) % 90 for k in range(4)]
        counts[i // 3 % 4] = bias - 15300 + (53 * i) % 400
        yield i * 0.05 + 0.01, "feet", {"counts": counts, "pitch": 0.02 * math.sin(i / 3), "step": i // 3}


def quartiles(m):
    """Yield each quartile and how far apart its neighbours are, 0 if it is one of the counts."""
    counts = sorted(math.trunc(each) for each in m["counts"])
    for quarter in (1, 2, 3):
        place, rest = divmod(quarter * (len(counts) - 1), 4)
        gap = counts[place + 1] - counts[place] if rest else 0
        yield counts[place] + gap * rest / 4, gap


def told(m):
    return bool(m["counts"]) and all(-32768 <= each <= 32767 for each in m["counts"])


def fails(log):
    for index, (_, topic, m) in enumerate(log):
        if topic == "feet" and told(m) and any(gap > 32767 for _, gap in quartiles(m)):
            return index


def shows(log, outputs):
    biases = {0.0} | {m["bias"] for _, topic, m in log if topic == "tare" and abs(m["bias"]) <= 1000}
    found = [[each for each, _ in quartiles(m)] for _, topic, m in log if topic == "feet" and told(m)]
    right = {tuple(round((each - bias) * 0.02, 6) for each in each_found) for each_found in found for bias in biases}
    return any(tuple(round(m[name], 6) for name in ("low", "middle", "high")) not in right for _, m in outputs)


def edges():
    log = list(nominal())
    for counts in (
        [-16768, 15999, 16000, 16000],
        [0, 32767, -1],
        [-32767, 0, 1, 32766],
        [-32768, 32767, -32768, 32767, -32768],
        [32767.9, -32768],
        [32767, 32766, -1.9, 32767],
        [math.nan, -30000, 30000],
        [7],
        [],
    ):
        yield False, changed(log, "feet", 30, counts=counts)
    for counts in (
        [-16768, 16000, 16000, 16000],
        [-32768, 32767],
        [32767, 32766, -2.9, 32767],
        [32767, -32768, 32767, -32768],
        [-19000, -19000, 14000, 14000],
    ):
        yield True, changed(log, "feet", 30, counts=counts)
    yield False, changed(log, "tare", 1, bias=-1000.0)
    yield False, changed(log, "tare", 2, bias=math.nan)


def draw(source):
    def counts():
        some = [near_integer(source, -16768, 16000) for _ in range(source.choice([2, 3, 4, 4, 4, 5, 8]))]
        return [min(32767, max(-32768, each)) for each in some]

    def swing():
        return source.sample([near_integer(source, -18768, -18768, -15000), 14300, 14250, 14000], 4)

    def bias():
        return near(source, 0.0, 1000.0, -1000.0)

    log = drawn(source, list(nominal()), "tare", bias=bias, celsius=lambda: near(source, 25.0))
    return drawn(source, log, "feet", counts=source.choice([counts, swing]), pitch=lambda: near(source, 0.0))
