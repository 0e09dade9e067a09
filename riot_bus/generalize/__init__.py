"""From one failing log to a readable rule: minimise, relevant fields, rule (RIOT II-B)."""
