"""Zenoh's Python API; all other packages use it through this module, so that only this package imports it."""

from zenoh import *  # noqa: F403 - the whole API
from zenoh import ext as ext
from zenoh import handlers as handlers
from zenoh import shm as shm
