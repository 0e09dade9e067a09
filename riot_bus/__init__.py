"""Robustness Inside-Out Testing (RIOT, Katz et al. 2020) on a message bus.

The rooms are described in ARCHITECTURE.md. Nothing is imported here, so that `riot --help` stays fast.
"""

__version__ = "0.1.0"
