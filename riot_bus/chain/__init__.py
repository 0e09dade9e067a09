"""The steps of RIOT over the files of a finding: each reads, asks a runner, and writes."""
