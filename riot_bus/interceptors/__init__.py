"""Shipped interceptors: timing faults, losses, and changes of payloads; and how to find and build any interceptor."""
