"""Recording a Zenoh network as one of its clients."""
