"""`riot init`: a first riot.toml from a live network, running processes or a recording."""
