"""Fails at a stop after an event that is written down, of severity 2 at least, with a character that Latin 1 lacks."""

from changes import changed, nth, without

WORDS = ("Spannung fällt", "drift > 2 %", "ok", "Kühlung 40 °C", "link lost", "½ throttle", "rêve", "brake: on")
PARTS = ("battery", "imu", "Lüfter", "radio", "motor 3")


def nominal():
    for i in range(62):
        yield (
            i * 0.5,
            "event",
            {
                "part": PARTS[i * 3 % 5],
                "severity": i * 7 % 6,
                "volts": 12.6 - 0.02 * i,
                "text": f"{WORDS[i % 8]} ({i})",
            },
        )
        if i in (30, 61):
            yield i * 0.5 + 0.2, "stop", {"uptime": 3600.0 + i * 0.5, "by": "operator"}


def fails(log):
    lost = False
    for index, (_, topic, m) in enumerate(log):
        if topic == "stop" and lost:
            return index
        if topic == "event" and m["severity"] >= 2:
            lost = lost or any(ord(each) > 255 for each in m["part"] + m["text"])


def edges():
    log = list(nominal())
    yield True, changed(log, "event", 40, severity=2, text="\u0100")
    yield True, changed(log, "event", 5, part="5 kΩ", text="", severity=9)
    yield True, changed(log, "event", severity=3, text="fine \ud83d")
    yield True, without(changed(log, "event", 50, severity=2, text="→ dock"), "event", 0, 40)
    yield False, changed(log, "event", 40, severity=2, text="\xff\x00\x85")
    yield False, changed(log, "event", 40, severity=1, text="→ dock")
    yield False, changed(log, "event", 40, severity=float("nan"), text="→ dock")
    yield False, without(changed(log, "event", 40, severity=2, text="→ dock"), "stop", 1)
    last = changed(log, "event", severity=2, text="→ dock")
    yield False, [*last[:-2], last[-1], last[-2]]


def draw(source):
    log = list(nominal())
    for _ in range(source.randint(1, 2)):
        top = source.choice([0x80, 0x101, 0x180, 0x3000])
        text = "".join(chr(source.randrange(32, top)) for _ in range(source.randint(0, 6)))
        field = source.choice(["part", "text"])
        log = changed(log, "event", source.randrange(62), severity=source.choice([-1, 0, 1, 2, 3, 5]), **{field: text})
    if source.random() < 0.2:
        del log[nth(log, "stop", source.choice([0, 1]))]
    return log
