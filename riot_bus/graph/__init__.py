"""The graph of publishers and subscribers of a bus, from sources that cannot harm a router; see `watch.GraphWatch`."""
