"""`riot diff`, `riot edit`, `riot export`, `riot import`."""
