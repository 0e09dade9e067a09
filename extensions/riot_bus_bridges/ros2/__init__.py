"""Bridges a ROS 2 domain, whatever its middleware, to a segment, where it looks like nodes of rmw_zenoh."""
