"""The Zenoh side of bridges to other middleware; the other side belongs to adapters."""
