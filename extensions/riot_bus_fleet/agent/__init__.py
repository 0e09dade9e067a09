"""`riot agent`: plays and records logs on a robot when it is told so from afar; and the side that tells it."""
