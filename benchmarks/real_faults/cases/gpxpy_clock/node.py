"""Keeps the track since the start, and tells after each fix how long and how far the vehicle has moved."""

import datetime

import gpxpy.gpx


def node(publish, checked):
    track = gpxpy.gpx.GPXTrackSegment()

    def fix(m):
        if not (m["quality"] > 0 and -90 <= m["lat"] <= 90 and -180 <= m["lon"] <= 180 and -500 <= m["alt"] <= 9000):
            return
        if not 0 <= m["stamp"] < 4e9:
            return
        time = datetime.datetime.fromtimestamp(m["stamp"], datetime.UTC)
        track.points.append(gpxpy.gpx.GPXTrackPoint(m["lat"], m["lon"], elevation=m["alt"], time=time))
        trip = track.get_moving_data()
        publish("trip", {"moving": trip.moving_time, "metres": trip.moving_distance, "fastest": trip.max_speed})

    return {"fix": fix}
