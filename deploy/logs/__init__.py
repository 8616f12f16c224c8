"""Logs of a run: reading, merging, recovery, description."""
