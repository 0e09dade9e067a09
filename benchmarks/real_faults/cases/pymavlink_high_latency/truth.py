"""Fails at a HIGH_LATENCY2 message from a PX4 autopilot, which is kind 12, if all its values fit into their fields."""

import math

from changes import changed, drawn, near_integer, without

PX4 = 12
BITS = {  # of the fields of HIGH_LATENCY2, negative for those with a sign
    "timestamp": 32, "type": 8, "autopilot": 8, "custom_mode": 16, "latitude": -32, "longitude": -32,
    "altitude": -16, "target_altitude": -16, "heading": 8, "target_heading": 8, "target_distance": 16,
    "throttle": 8, "airspeed": 8, "airspeed_sp": 8, "groundspeed": 8, "windspeed": 8, "wind_heading": 8,
    "eph": 8, "epv": 8, "temperature_air": -8, "climb_rate": -8, "battery": -8, "wp_num": 16,
    "failure_flags": 16, "custom0": -8, "custom1": -8, "custom2": -8,
}  # fmt: skip


def nominal():
    for i in range(80):
        if i % 4:
            yield i * 0.25, "heartbeat", {
                "type": 2, "autopilot": 3, "base_mode": 81 + 128 * (i > 20), "custom_mode": (0, 4, 5)[i // 30],
                "system_status": 3 + (i > 20), "mavlink_version": 3,
            }  # fmt: skip
            continue
        way = math.sin(i / 11)
        yield i * 0.25, "satellite", dict.fromkeys(BITS, 0) | {
            "timestamp": 70_000 + 250 * i, "type": 2, "autopilot": 3, "custom_mode": (0, 4, 5)[i // 30],
            "latitude": 525_200_000 + 300 * i, "longitude": 134_000_000 + round(9000 * way), "altitude": 40 + i,
            "target_altitude": 120, "heading": round(90 + 60 * way), "target_heading": 95, "target_distance": 90 - i,
            "throttle": 40 + i % 9, "airspeed": 60, "airspeed_sp": 62, "groundspeed": 55 + i % 7, "windspeed": 12,
            "wind_heading": 120, "eph": 9, "epv": 14, "temperature_air": 11, "climb_rate": round(20 * way),
            "battery": 97 - i // 3, "wp_num": 1 + i // 16, "custom0": 81 - 128 * (i > 20),
        }  # fmt: skip


def fits(value, bits):
    return -(2 ** (-bits - 1)) <= value < 2 ** (-bits - 1) if bits < 0 else 0 <= value < 2**bits


def fails(log):
    for index, (_, topic, m) in enumerate(log):
        if topic == "satellite" and m["autopilot"] == PX4 and all(fits(m[name], bits) for name, bits in BITS.items()):
            return index


def edges():
    log = list(nominal())
    yield True, changed(log, "satellite", autopilot=PX4)
    yield True, changed(log, "satellite", 3, autopilot=PX4, custom0=-128, battery=-1, type=255)
    yield True, without(changed(log, "satellite", autopilot=PX4), "heartbeat", 0, 60)
    yield False, changed(log, "satellite", autopilot=11)
    yield False, changed(log, "satellite", autopilot=13)
    yield False, changed(log, "heartbeat", 10, autopilot=PX4)
    yield False, changed(log, "satellite", autopilot=PX4, heading=256)


def draw(source):
    log = drawn(source, list(nominal()), "heartbeat", 3, autopilot=lambda: source.choice([PX4, source.randrange(20)]))
    return drawn(
        source,
        log,
        "satellite",
        2,
        autopilot=lambda: source.choice([PX4, PX4, PX4, PX4, 11, 13, source.randrange(256)]),
        type=lambda: source.randrange(40),
        heading=lambda: near_integer(source, 0, 255),
        battery=lambda: near_integer(source, -1, 127),
        custom_mode=lambda: near_integer(source, 0, 65535),
    )
