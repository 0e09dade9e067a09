"""`riot bridge`, `riot ros-test`."""
