"""MAVLink for riot_bus."""
