"""Helpers for authors of adapters and interceptors."""
