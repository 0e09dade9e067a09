"""A robust MCAP engine that knows nothing of RIOT: scan, salvage, chunks, compression, whole records only."""
