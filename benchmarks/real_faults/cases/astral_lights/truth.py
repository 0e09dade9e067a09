"""A control: there is no fault to trigger."""


def nominal():
    for i in range(96):
        place = {"lat": 60.17 + 0.003 * i, "lon": 24.94 + 0.005 * (i % 30)}
        yield i * 0.1, "fix", {"id": "rover 3", "utc": 1772323200.0 + 900 * i, "cloud": 0.1 * (i % 8), **place}
