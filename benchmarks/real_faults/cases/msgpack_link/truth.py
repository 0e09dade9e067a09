"""A control: there is no fault to trigger."""


def nominal():
    for i in range(100):
        cells = [3.7 + 0.01 * ((i + cell) % 9) for cell in range(6)]
        note = "" if i % 9 else f"relay {i // 9} éteint"
        yield i * 0.1, "telemetry", {"seq": 70000 + i, "temp": 24.5 + 0.2 * (i % 11), "cells": cells, "note": note}
