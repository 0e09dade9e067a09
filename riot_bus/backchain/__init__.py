"""From the rule to the outside world: permeability and activation (RIOT II-C, II-D)."""
