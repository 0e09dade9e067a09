"""A running router as people and programs see it: commands, status, options and the foreground process."""
