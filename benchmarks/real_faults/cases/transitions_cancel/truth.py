"""Fails at a stop during a drive: the order stays in the queue, and nothing is carried out any more."""

from changes import changed, drawn, nth, without


def nominal():
    for i in range(30):
        station = f"S{i * 7 % 12}"
        yield i * 0.5, "order", {"station": station, "load": 5.0 + i * 3 % 17, "priority": i % 3}
        yield i * 0.5 + 0.2, "tag", {"station": station, "range": 0.1 + 0.03 * (i % 9), "rssi": -50 - i % 20}
        if i % 4 == 1:
            yield i * 0.5 + 0.3, "stop", {"source": "pendant", "pressed": 0.2 + 0.1 * (i % 3)}


def story(log):
    """Return the modes that there should be, and the first stop during a drive."""
    station, driving, modes, failing = None, False, [], None
    for index, (_, topic, m) in enumerate(log):
        if topic == "order" and not driving:
            station, driving = m["station"], True
            modes.append({"mode": "driving", "station": station})
        elif driving and (topic == "stop" or (topic == "tag" and m["station"] == station and m["range"] < 0.5)):
            driving = False
            modes.append({"mode": "parked", "station": station})
            if topic == "stop" and failing is None:
                failing = index
    return modes, failing


def fails(log):
    return story(log)[1]


def shows(log, outputs):
    return len(outputs) < len(story(log)[0])


def swapped(log, number):
    """Return a log in which a stop comes just before the tag."""
    found = list(log)
    index = nth(log, "stop", number)
    (at, _, stop), (_, _, tag) = found[index], found[index - 1]
    found[index - 1 : index + 1] = [(at - 0.11, "stop", stop), (at - 0.1, "tag", tag)]
    return found


def edges():
    log = list(nominal())
    yield True, swapped(log, 0)
    yield True, swapped(log, -1)
    yield True, without(log, "tag", 1)
    yield True, changed(log, "tag", 5, range=0.5)
    yield True, changed(log, "tag", 1, station="S6")
    yield False, changed(log, "tag", 1, range=0.4999)
    yield False, without(log, "tag", 2)[:6]
    yield False, without(log, "order", 5)
    yield False, without(log, "stop", 1, 5)
    yield True, without(log, "tag", -1)
    yield False, without(without(log, "tag", -1), "stop", -1)


def draw(source):
    log = list(nominal())
    match source.randrange(4):
        case 0:
            log = swapped(log, source.randrange(7))
        case 1:
            log = without(
                log, source.choice(["tag", "order", "stop"]), source.randrange(30), source.choice([1, 1, 2, 4])
            )
        case 2:
            log.insert(source.randrange(len(log)), log[nth(log, source.choice(["order", "tag", "stop"]))])
        case 3:
            at = lambda: source.choice([0.0, 0.49, 0.5, 0.51, 1e9, float("nan"), -1.0])  # noqa: E731
            log = drawn(source, log, "tag", 2, range=at, station=lambda: f"S{source.randrange(12)}")
    return log
