"""Tables of a log in formats of other tools."""
