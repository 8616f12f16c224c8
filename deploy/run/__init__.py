"""Runs: live, in virtual time, replayed; from a scenario to a summarised folder."""
