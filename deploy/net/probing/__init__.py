"""Measurement of a network: probe and reflector."""
