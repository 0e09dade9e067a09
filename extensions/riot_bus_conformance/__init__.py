"""Tests whether components can tell a riot bus from one plain Zenoh router: scenarios run on both and are compared.

`scenario` defines what a scenario is, `scenarios` contains them by theme, `end` is what an end can do,
`conductor` runs the two ends in separate processes, `network` opens the network between them, and `run` compares what
they observed.
"""
