"""Whether components can tell a riot bus from one plain Zenoh router: scenarios run through both and are compared.

`scenario` says what a scenario is, `scenarios` holds them by theme, `end` is what the code of an end may do,
`conductor` runs the two ends in processes of their own, `network` opens what lies between them, and `run` compares
what they saw.
"""
