"""The system under test: its file, its processes, and trials."""
