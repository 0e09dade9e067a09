"""A control: there is no fault to trigger."""

import math


def nominal():
    for i in range(90):
        lat, lon = 47.3977 + 2e-4 * math.sin(i / 7), 8.5456 + 3e-4 * math.cos(i / 7)
        yield (
            i * 0.1,
            "fix",
            {"lat": lat, "lon": lon, "alt": 488.0 + 0.5 * (i % 40), "hdop": 0.8 + 0.1 * (i % 5), "sats": 9 + i % 4},
        )
