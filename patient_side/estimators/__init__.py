"""Estimators of the arm's position now, by name: one small file each, one protocol."""
