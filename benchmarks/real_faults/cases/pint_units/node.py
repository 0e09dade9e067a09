"""Brings readings to SI units, and keeps the least and the greatest of each sensor; unknown units are passed over."""

import pint

UNITS = pint.UnitRegistry()
KNOWN = {
    "baro": ("pascal", {"hPa", "inHg", "psi", "mbar"}),
    "motor": ("kelvin", {"degC", "degF", "kelvin"}),
    "sonar": ("meter", {"cm", "inch", "foot", "mm"}),
    "pitot": ("meter / second", {"knot", "km/h", "mph"}),
}


def node(publish, checked):
    extremes = {}

    def reading(m):
        if m["sensor"] not in KNOWN or not -1e6 <= m["value"] <= 1e6 or not 0 <= m["quality"] <= 1:
            return
        unit, allowed = KNOWN[m["sensor"]]
        if m["unit"] not in allowed or m["quality"] < 0.5:
            return
        value = float(UNITS.Quantity(m["value"], m["unit"]).to(unit).magnitude)
        if value < 0:
            return
        least, greatest = extremes.get(m["sensor"], (value, value))
        extremes[m["sensor"]] = min(least, value), max(greatest, value)
        publish("si", {"sensor": m["sensor"], "value": value, "unit": unit, "extremes": extremes[m["sensor"]]})

    return {"reading": reading}
