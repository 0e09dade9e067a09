"""Fields of logs as arrays and tables, read from the bytes of chunks."""
