"""Folder of a standalone netem, which connected two networks without a scenario."""
