"""The system under test as its file says: riot.toml, and the code that belongs to it."""
