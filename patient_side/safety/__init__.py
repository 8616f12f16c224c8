"""Checks of what the patient believes."""
