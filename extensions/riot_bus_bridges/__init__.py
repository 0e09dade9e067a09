"""Joins other middleware to segments: the host of bridges, ROS 2 over DDS, MAVLink links, `riot ros-test`."""
