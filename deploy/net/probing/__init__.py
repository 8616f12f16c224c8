"""Measurement of a network: probe, reflector and far end."""
