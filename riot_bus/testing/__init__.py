"""Helpers for authors of adapters, codecs and interceptors."""
