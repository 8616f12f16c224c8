"""Measured networks: the profile library, the probe that records a network, the fit that makes a profile of it."""
