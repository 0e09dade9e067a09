"""A small autonomous rover: one process per component, ROS 2 messages on Zenoh."""
