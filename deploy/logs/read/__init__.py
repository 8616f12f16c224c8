"""From the logs of a run to columns."""
