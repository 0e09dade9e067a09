"""Fails at a datagram with a sentence of 0 fragments, whatever its number and checksum, if it is not too large."""

import functools
import math
import operator
import re

from changes import changed

SENTENCE = re.compile(r"![A-Z]{2}VD[MO],([0-9]{1,3}),([0-9]{1,3}),[0-9]?,[AB]?,([0-W`-w]*),[0-9]\*[0-9A-F]{2}")


def armored(*fields):
    bits = "".join(f"{value % 2**width:0{width}b}" for value, width in fields)
    sixes = [int(bits[i : i + 6].ljust(6, "0"), 2) for i in range(0, len(bits), 6)]
    return "".join(chr(six + (48 if six < 40 else 56)) for six in sixes)


def sentence(payload, count=1, number=1, group="", fill=0, channel="A"):
    body = f"AIVDM,{count},{number},{group},{channel},{payload},{fill}"
    return f"!{body}*{functools.reduce(operator.xor, body.encode()):02X}"


def position(i):
    lat, lon = round((54.3 + 0.01 * math.sin(i / 7)) * 600000), round((10.2 + 0.001 * i) * 600000)
    head = (1, 6), (0, 2), (211200300 + i % 9, 30), (0, 4), (0, 8), (70 + i % 20, 10), (1, 1)
    return armored(*head, (lon, 28), (lat, 27), (900 + 10 * i, 12), (90 + i, 9), (i % 60, 6), (0, 25))


def static(i):
    return armored((5, 6), (0, 2), (211200300 + i % 9, 30), (0, 2), (9000000 + i, 30), (0, 162), (70, 8), (0, 184))


def nominal():
    for i in range(72):
        lines = [sentence(position(i), channel="AB"[i % 2])]
        if i % 6 == 5:
            whole = static(i)
            lines += [sentence(whole[:58], 2, 1, i % 10), sentence(whole[58:], 2, 2, i % 10, 2)]
        yield i * 0.5, "ais", {"station": f"rx{i % 3}", "level": -70 + i % 11, "data": "\r\n".join(lines)}


def fails(log):
    for index, (_, _, m) in enumerate(log):
        found = filter(None, map(SENTENCE.fullmatch, m["data"].splitlines()))
        if any(int(f[1]) == 0 and int(f[2]) <= 100 and len(f[3]) <= 200 for f in found):
            return index


def edges():
    log = list(nominal())
    yield True, changed(log, "ais", 9, data=sentence(position(9), 0, 1))
    yield True, changed(log, "ais", data=sentence(position(7)) + "\r\n" + sentence(static(1)[:58], 0, 2, 3))
    yield True, changed(log, "ais", 0, data=sentence(position(9), "000", 0).split("*")[0] + "*00")
    yield True, changed(log, "ais", data=sentence("", 0, 100))
    yield False, changed(log, "ais", data=sentence("", 0, 101))
    yield False, changed(log, "ais", 9, data=sentence(position(9), 1, 0))
    yield False, changed(log, "ais", 9, data=sentence(position(9), "-0", 1))
    yield False, changed(log, "ais", 9, data=sentence(static(1)[:58], 2, 1))
    yield True, changed(log, "ais", 9, data=sentence("0" * 200, 0, 1))
    yield False, changed(log, "ais", 9, data=sentence("0" * 201, 0, 1))


def draw(source):
    counts = [0, 0, 0, 0, "00", "-1", "", 1, 2, 10, 100, 101]
    line = sentence(
        source.choice([position, static])(source.randrange(99))[: source.choice([0, 5, 28, 58, 200])],
        source.choice(counts), source.choice([0, 1, 1, 1, 2, 3, 99, 100, 101]), source.choice(["", 0, 1, 9]),
    )  # fmt: skip
    if source.random() < 0.2:
        at = source.randrange(len(line))
        line = line[:at] + source.choice(["0", "", ",", "é", "x"]) + line[at + 1 :]
    lines = source.sample([line, sentence(position(3)), sentence(static(3)[:58], 2, 1, 7)], source.randint(1, 3))
    return changed(list(nominal()), "ais", source.randrange(72), data="\n".join(lines))
