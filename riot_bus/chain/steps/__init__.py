"""The steps of RIOT: each reads the files of a finding, asks a runner, and writes a file of its own."""
