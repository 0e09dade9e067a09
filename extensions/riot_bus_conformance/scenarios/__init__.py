"""Scenarios by theme; every module here is loaded."""
