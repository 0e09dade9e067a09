"""Bridges MAVLink links (UDP, TCP, serial, logs) to segments, and routes between them."""
