"""A fleet's logs: where they are and what is in them, without opening each of them again."""
