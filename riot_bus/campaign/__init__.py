"""Robustness testing: schedule, executors, store of trials, findings."""
