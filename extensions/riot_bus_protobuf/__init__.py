"""Protocol Buffers: types from descriptor sets; fields are read and changed where they lie on the wire."""
