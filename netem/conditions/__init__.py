"""Conditions that change during a run: outages, joint states, the timeline."""
