"""Message types: what fields a payload has, reading them, and patching scalars in place."""
