"""A small drone, flown by a script, and those on the ground who talk MAVLink with it."""
