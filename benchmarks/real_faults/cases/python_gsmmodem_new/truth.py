"""Fails at an alarm that is sent and has a character above U+FFFF within the first 280 of the message."""

from changes import changed, drawn

TEXTS = (
    "wheel 3 blocked",
    "Hindernis größer als 2 m",
    "cannot reach {goal}, 5€ says the map is old",
    "Дверь закрыта",
    "low battery, going home [dock 2]",
    "ドックが見つかりません",
    "path replanned after " + "9 tries, " * 20,
    "temperature of motor ♨ is high ✔",
)


def nominal():
    for i in range(64):
        text = f"{TEXTS[i * 5 % 8]} #{i}"
        yield i * 2.0, "alarm", {"level": i % 4, "robot": f"rover-{i % 3}", "text": text, "battery": 24.6 - 0.05 * i}


def fails(log):
    for index, (_, _, m) in enumerate(log):
        text = " ".join(f"⚠ {m['robot']}: {m['text']} ({m['battery']} V)".split())
        if m["level"] >= 2 and any(each > "\uffff" for each in text[:280]):
            return index


def edges():
    log = list(nominal())
    yield True, changed(log, "alarm", text="\U00010000")
    yield False, changed(log, "alarm", text="\uffff")
    yield True, changed(log, "alarm", level=2, robot="🤖")
    yield False, changed(log, "alarm", level=1, robot="🤖")
    yield True, changed(log, "alarm", robot="r", text="ж" * 274 + "😀")
    yield False, changed(log, "alarm", robot="r", text="ж" * 275 + "😀")
    yield True, changed(log, "alarm", 2, text="\U0010ffff" + "a" * 999)
    yield False, changed(log, "alarm", text="\x0c \ud83d \ude00 \x00 ❤️ ⚠ ☠️")
    yield False, changed(log, "alarm", text="ÿ")
    yield False, changed(log, "alarm", text="")
    yield False, changed(log, "alarm", text="{[€~]}" * 99)


def draw(source):
    def text():
        parts = [
            "🚨",
            "ÿ",
            "\U00010000",
            "\uffff",
            "⚠",
            "é",
            "€",
            "{",
            " ",
            "\n",
            "\x0c",
            "\x1b",
            "\0",
            "й",
            "abc" * 30,
        ]
        return "".join(source.choices(parts, k=source.choice([0, 1, 4, 9])))

    return drawn(
        source,
        list(nominal()),
        "alarm",
        robot=text,
        text=text,
        level=lambda: source.choice([-1, 1, 2, 3, 1.9, float("nan"), float("inf")]),
        battery=lambda: source.choice([0.0, 24.0, float("nan"), -1e300]),
    )
