"""Many trials: worker processes, what is sent to them, and the runners that the steps ask."""
