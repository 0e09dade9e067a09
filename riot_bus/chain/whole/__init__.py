"""Runs of the whole system with external fields driven, and what they show."""
