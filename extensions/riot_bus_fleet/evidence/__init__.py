"""`riot backchain`: which external fields an internal field follows, from nominal logs alone."""
