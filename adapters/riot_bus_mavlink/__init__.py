"""MAVLink for riot_bus: frames, dialects, types of messages, signing, tlogs."""
