"""Dictionaries of exceptional values, and of mutations of ROS 2 messages, that ship with riot_bus."""
