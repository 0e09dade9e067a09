"""Dictionaries of exceptional values that ship with riot_bus."""
