"""Processes of components: how they are started, watched, looked into and ended."""
