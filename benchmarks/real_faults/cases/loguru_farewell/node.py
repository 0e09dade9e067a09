"""Keeps the diary of a vehicle in a file for a station that knows Latin 1 only; flushes it when told to stop."""

import tempfile

from loguru import logger


def node(publish, checked):
    diary = tempfile.TemporaryFile("w", encoding="latin-1")  # noqa: SIM115 - open as long as the node
    logger.remove()
    logger.add(diary, format="{time:HH:mm:ss} {level} {message}", level="INFO", enqueue=True, catch=False)
    told = {"events": 0, "alarms": 0}

    def event(m):
        told["events"] += 1
        level = "WARNING" if m["severity"] >= 4 else "INFO" if m["severity"] >= 2 else "DEBUG"
        logger.log(level, "{} ({:.1f} V): {}", m["part"], m["volts"], m["text"])
        if level == "WARNING":
            told["alarms"] += 1
            publish("alarm", {"part": m["part"], "volts": m["volts"], "count": told["alarms"]})

    def stop(m):
        logger.info("stopped after {:.0f} s", m["uptime"])
        logger.complete()
        publish("bye", told)

    return {"event": event, "stop": stop}
