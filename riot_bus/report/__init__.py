"""Reports of findings and campaigns for people and for other tools."""
