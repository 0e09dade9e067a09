"""`riot agent`, `riot backchain`, `riot fleet`, `riot scan`."""
