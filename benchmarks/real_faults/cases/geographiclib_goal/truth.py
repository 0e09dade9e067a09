"""A control: there is no fault to trigger."""


def nominal():
    for i in range(100):
        if i % 20 == 0:
            there = {"lat": 59.91 + 0.001 * (i // 20), "lon": 10.75 - 0.002 * (i // 20)}
            yield i * 0.1, "goal", {"name": f"buoy {i // 20 + 1}", "radius": 15.0, **there}
        else:
            here = {"lat": 59.91 + 5e-5 * i, "lon": 10.75 - 1e-4 * i}
            yield i * 0.1, "position", {"heading": (310.0 + 3 * i) % 360, "speed": 3.5, **here}
