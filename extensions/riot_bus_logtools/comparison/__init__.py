"""Two logs side by side: did the system answer the same? Count, order and values, apart from timing."""
