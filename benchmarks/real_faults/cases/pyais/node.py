"""Tells ships from the datagrams of an AIS receiver, of a few lines each; lines that are no AIS are passed over."""

import re

import pyais
from pyais.exceptions import AISBaseException

SENTENCE = re.compile(r"![A-Z]{2}VD[MO],[0-9]{1,3},[0-9]{1,3},[0-9]?,[AB]?,[0-W`-w]*,[0-9]\*[0-9A-F]{2}")


def node(publish, checked):
    def ais(m):
        lines = [line.encode() for line in m["data"].splitlines() if SENTENCE.fullmatch(line)]
        for message in pyais.IterMessages(lines):
            try:
                ship = message.decode()
            except AISBaseException:  # too short, or of an unknown type
                continue
            place = {"lat": getattr(ship, "lat", None), "lon": getattr(ship, "lon", None)}
            publish("ships", {"mmsi": ship.mmsi, "type": ship.msg_type, "station": m["station"], **place})

    return {"ais": ais}
