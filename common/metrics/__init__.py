"""Metrics of a run: pure functions of arrays, whose results use the names of ``summary.json``."""
