"""Logs as files for others: merged, exported, recovered, and described."""
