"""What the fixtures of the pytest plug-in give: a router, its messages, campaigns within tests."""
