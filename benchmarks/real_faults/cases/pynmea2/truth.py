"""Fails at an RMC sentence, right but for a date or a time that is blank."""

import functools
import operator

from changes import changed

FIELDS = ("time", "status", "lat", "ns", "lon", "ew", "knots", "course", "date", "variation", "ve")
USUAL = dict(
    zip(
        FIELDS,
        ["101112.00", "A", "5231.0000", "N", "01324.0000", "E", "0.5", "84.4", "230394", "3.1", "W"],
        strict=True,
    )
)


def sentence(**fields):
    body = ",".join(["GPRMC", *(USUAL | fields).values()])
    return f"${body}*{functools.reduce(operator.xor, body.encode()):02X}"


def nominal():
    for i in range(60):
        yield i * 0.1, "nmea", {"line": sentence(time=f"1011{i:02d}.00", lat=f"52{i:02d}.1000")}


def fails(log):
    for index, (_, _, m) in enumerate(log):
        parts, _, total = m["line"].strip().partition("*")
        right = parts[:1] == "$" and total.upper() == f"{functools.reduce(operator.xor, parts[1:].encode(), 0):02X}"
        words = parts.split(",")
        if right and words[0][-3:] == "RMC" and len(words) > 9 and not (words[1] and words[9]):
            return index


def edges():
    log = list(nominal())
    yield True, changed(log, "nmea", line=sentence(date=""))
    yield True, changed(log, "nmea", 9, line=sentence(time=""))
    yield False, changed(log, "nmea", line=sentence(date="").replace("*", "*0"))
    yield False, changed(log, "nmea", line=sentence(course="", variation="", ve=""))
    yield False, changed(log, "nmea", line=sentence(status="V", lat="", ns="", lon="", ew=""))


def draw(source):
    blank = dict.fromkeys(source.sample(FIELDS, source.randint(0, 3)), "")
    line = sentence(**blank)
    if source.random() < 0.2:
        line = line[: source.randrange(len(line))]
    return changed(list(nominal()), "nmea", source.randrange(60), line=line)
