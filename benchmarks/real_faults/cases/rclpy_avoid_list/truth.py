"""Fails at a plan without places to avoid: nobody agrees to it, and the robot goes on with the one before."""

import math

from changes import changed, drawn, near, without


def nominal():
    for i in range(90):
        if i % 5 == 2:
            places = [round((0.37 * i + 3.1 * k) % 20, 2) for k in range(1 + i // 5 * 3 % 4)]
            yield i * 0.2, "plan", {"id": i // 5, "speed": 0.4 + 0.1 * (i % 3), "lane": 0.2 * (i % 2), "avoid": places}
            continue
        x = 0.09 * i
        yield i * 0.2, "pose", {"x": x, "y": 0.1 * math.sin(x), "yaw": 0.05 * math.cos(x)}


def fails(log):
    for index, (_, topic, m) in enumerate(log):
        if topic == "plan" and not m["avoid"]:
            return index


def shows(log, outputs):
    return sum(topic == "agreed" for topic, _ in outputs) < sum(topic == "plan" for _, topic, _ in log)


def edges():
    log = list(nominal())
    yield True, changed(log, "plan", avoid=[])
    yield True, changed(log, "plan", 0, avoid=[], speed=0.5, lane=0.0)
    yield True, without(changed(log, "plan", 9, avoid=[]), "plan", 0, 9)
    yield False, changed(log, "plan", 9, avoid=[math.nan])
    yield False, changed(log, "plan", 9, avoid=[0.0])
    yield False, changed(log, "plan", 9, avoid=[-math.inf, 1e308, 5e-324], speed=math.nan, lane=-math.inf)
    yield False, without(log, "plan", 0, 18)


def draw(source):
    def avoid():
        few = source.choice([0, 0, 1, source.randint(0, 6)])
        return [source.choice([math.nan, math.inf, near(source, 0.0, 20.0)]) for _ in range(few)]

    log = drawn(source, list(nominal()), "plan", 2, avoid=avoid, speed=lambda: near(source, 0.0, 0.5))
    return drawn(source, log, "pose", 3, x=lambda: near(source, 0.0, 20.0), yaw=lambda: near(source, 0.0, math.pi))
