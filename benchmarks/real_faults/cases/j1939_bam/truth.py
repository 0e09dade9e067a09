"""Fails at a frame that makes up the size that was announced, though the frames were not numbered one by one."""

import math

from changes import changed, without

SPEED, ANNOUNCE, FRAME = 0x0CF00400, 0x1CECFF00, 0x1CEBFF00


def nominal():
    number = 0
    for i in range(15):
        curve = [byte for k in range(10) for byte in reversed(divmod(1000 + 37 * i + 400 * k + 3000 * (i % 2), 256))]
        first, second, third = ([k + 1, *[*curve, 255][7 * k : 7 * k + 7]] for k in range(3))
        speed = [240, 125, 130, int(90 + 90 * math.sin(i)), 40 + i, 0, 244, 125]
        source = i % 5 == 4
        frames = [(ANNOUNCE + source, [32, 20, 0, 3, 255, 0xE3, 0xFE, 0]), (FRAME + source, first), (SPEED, speed)]
        for can_id, data in [*frames, (FRAME + source, second), (FRAME + source, third)]:
            stamp = 1.7e9 + number * 0.01
            yield number * 0.01, "can", {"id": can_id, "extended": True, "data": data, "stamp": stamp}
            number += 1


def curves(log, *, strict=True):
    """Yield index, source and bytes of each torque curve; if strict, only those with all frames in order."""
    announced = {}
    for index, (_, _, m) in enumerate(log):
        can_id, data = m["id"], m["data"]
        if not (m["extended"] and isinstance(can_id, int) and 0 <= can_id < 1 << 29):
            continue
        if len(data) != 8 or not set(data) <= set(range(256)):
            continue
        data = [int(byte) for byte in data]
        source, group, to = can_id & 0xFF, can_id >> 16 & 0x1FF, can_id >> 8 & 0xFF
        if (group, to) == (0xFE, 0xE3):
            yield index, source, data
        elif (group, to) == (0xEC, 0xFF) and (data[0] == 32 or (data[0] == 16 and source not in announced)):
            announced[source] = data[1] + 256 * data[2], data[5:] == [0xE3, 0xFE, 0], [], []
        elif (group, to) == (0xEB, 0xFF) and source in announced:
            size, curve, numbers, received = announced[source]
            numbers.append(data[0])
            received += data[1:]
            if len(received) >= size:
                del announced[source]
                if curve and (not strict or numbers == list(range(1, len(numbers) + 1))):
                    yield index, source, received[:size]


def points(data):
    return [data[i] | data[i + 1] << 8 for i in range(0, len(data) - 1, 2)]


def fails(log):
    right = [(source, points(data)) for _, source, data in curves(log)]
    every = ((index, (source, points(data))) for index, source, data in curves(log, strict=False))
    return next((index for index, curve in every if curve not in right), None)


def shows(log, outputs):
    right = [(source, points(data)) for _, source, data in curves(log)]
    return any((fields["source"], fields["points"]) not in right for topic, fields in outputs if topic == "curve")


def edges():
    log = list(nominal())
    second, third = ([i for i, each in enumerate(log) if each[2]["data"][0] == k] for k in (2, 3))
    yield True, without(log, "can", third[1], 2)
    yield False, without(log, "can", second[7], 5)
    yield True, without(log, "can", second[2], 3)
    yield True, [*log[: second[3]], log[second[3]], *log[second[3] :]]
    yield True, [*log[: second[5]], log[third[5]], log[second[5]], *log[third[5] + 1 :]]
    yield True, changed(log, "can", third[4], data=[4, 1, 2, 3, 4, 5, 6, 7])
    yield False, changed(log, "can", third[4], data=[3, 1, 2, 3, 4, 5, 6, 7])
    yield False, without(log, "can", third[3], 2)
    yield False, without(log, "can", third[1])
    yield False, without(log, "can", second[1])
    yield False, without(log, "can", third[1] + 1)
    yield False, without(log, "can", third[1] + 1, 2)
    yield False, without(log, "can", second[1], 4)


def draw(source):
    log = list(nominal())
    index = source.randrange(len(log))
    match source.randrange(5):
        case 0:
            log.insert(index + source.randint(1, 3), log[index])
        case 1:
            log.insert(max(0, index - source.randint(1, 3)), log.pop(index))
        case 2:
            data = list(log[index][2]["data"])
            data[source.choice([0, 0, 0, 1, 2, 3, 5, 7])] = source.choice([0, 1, 2, 3, 4, 16, 17, 32, 255, 256, -1])
            log = changed(log, "can", index, data=data)
            return without(log, "can", source.randrange(70), 2) if source.random() < 0.3 else log
        case 3:
            bits = source.choice([1, 1, 2, 1 << 8, 1 << 16, 1 << 24, 1 << 25, 1 << 26, 1 << 29])
            return changed(log, "can", index, id=log[index][2]["id"] ^ bits)
        case 4:
            return without(log, "can", index, source.randint(1, 6))
    return log
