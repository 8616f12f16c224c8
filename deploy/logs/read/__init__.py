"""Logs of a run as columns."""
