"""Dictionaries of exceptional values, injection plans, and the interceptor that carries them out."""
