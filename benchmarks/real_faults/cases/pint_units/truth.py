"""A control: there is no fault to trigger."""

READINGS = [
    ("baro", 1013.0, "hPa"),
    ("motor", 41.0, "degC"),
    ("sonar", 180.0, "cm"),
    ("pitot", 24.0, "knot"),
    ("baro", 29.9, "inHg"),
    ("motor", 104.0, "degF"),
    ("sonar", 71.0, "inch"),
    ("pitot", 45.0, "km/h"),
]


def nominal():
    for i in range(96):
        sensor, value, unit = READINGS[i % 8]
        value = round(value * (1 + 0.004 * (i // 8)), 3)
        yield i * 0.1, "reading", {"sensor": sensor, "value": value, "unit": unit, "quality": 0.75 + 0.05 * (i % 5)}
