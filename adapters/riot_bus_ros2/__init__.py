"""ROS 2 for riot_bus: topic names of rmw_zenoh and types in CDR."""
