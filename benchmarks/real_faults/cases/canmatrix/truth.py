"""Fails at a status frame whose page is one of those that the controller has above 127."""

import math

from changes import changed, near_integer


def page(number, *words):
    data = bytes([number]) + b"".join(word.to_bytes(2, "little", signed=True) for word in words)
    return list(data.ljust(8, b"\0"))


def nominal():
    for i in range(80):
        speed = round(3000 * math.sin(i / 9))
        match i % 4:
            case 0:
                fields = {"id": 0x181, "data": page(1, speed, -speed // 7)}
            case 1:
                fields = {"id": 0x181, "data": page(2, 4810 - i, speed // 11)}
            case 2:
                fields = {"id": 0x701, "data": [5]}
            case 3:
                fields = {"id": 0x181, "data": page(3, (40 + i // 8) * 257)}
        yield i * 0.05, "can", {"channel": i // 40 % 2, **fields}


def fails(log):
    for index, (_, _, m) in enumerate(log):
        whole = len(m["data"]) == 8 and all(isinstance(each, int) and 0 <= each <= 255 for each in m["data"])
        if m["id"] == 0x181 and whole and m["data"][0] in (0x80, 0xF0, 0xFF):
            return index


def edges():
    log = list(nominal())
    yield True, changed(log, "can", 8, data=page(0x80))
    yield False, changed(log, "can", 8, data=page(0x7F))
    yield False, changed(log, "can", 8, data=page(0x81))
    yield True, changed(log, "can", 9, data=page(0xF0, -1, -1, -1))
    yield True, changed(log, "can", 11, data=page(0xFF, 3, 1))
    yield False, changed(log, "can", 11, data=page(-1 % 256, 3, 1)[:7])
    yield False, changed(log, "can", 11, data=page(0xFF, 3, 1), id=0x701)
    yield False, changed(log, "can", 11, data=[255, 0, 0, 0, 0, 0, 0, 256])
    yield False, changed(log, "can", 10, data=page(0x80))
    yield True, changed(log, "can", 10, data=page(0x80), id=0x181)


def draw(source):
    data = [source.randrange(256) for _ in range(source.choice([7, 8, 8, 8, 8, 8, 9]))]
    data[0] = source.choice([0x80, 0xF0, 0xFF, 0x80, 0xF0, 0xFF, near_integer(source, 0, 3, 128, 255)])
    if source.random() < 0.1:
        data[source.randrange(7)] = source.choice([-1, 256, 128, 127])
    return changed(
        list(nominal()), "can", source.randrange(80), data=data, id=source.choice([0x181, 0x181, 0x181, 0x182])
    )
