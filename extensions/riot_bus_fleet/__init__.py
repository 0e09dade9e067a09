"""A fleet's robots and logs: the agent, the catalogue, scans, and evidence from logs alone."""
