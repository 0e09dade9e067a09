"""Logs are MCAP: writer, reader, player."""
