"""Messages of logs in their order and at their pace."""
