"""Oracles that watch one trial and may report a violation."""
