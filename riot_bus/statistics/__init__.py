"""Statistics that several rooms share: rates and their intervals."""
