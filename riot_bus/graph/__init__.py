"""Who talks to whom on a bus, from sources that cannot harm a router; see `watch.GraphWatch`."""
