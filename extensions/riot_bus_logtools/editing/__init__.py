"""Make a log of logs: keep, drop, change, rename, merge, split and recover; what is not touched keeps its bytes."""
