"""The router: forwarding of intercepted messages, delivery, proxies of advanced publishers, services."""
