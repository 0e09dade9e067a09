"""Segments, junction and router: the only room that imports zenoh."""
