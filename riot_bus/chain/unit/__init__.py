"""Questions to a unit, and what is made of the answers: what a failure needs, rules and their uses."""
