"""Playing logs into a network: the Zenoh side of `riot_bus.log.playback.player`."""
