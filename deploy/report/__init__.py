"""From the logs of a run to what a person reads."""
