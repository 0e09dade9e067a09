"""What about this host would spoil a run, and whether the router is transparent here."""
