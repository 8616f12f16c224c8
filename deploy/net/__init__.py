"""Measured networks: profile library, probe that records a network, fit that turns a record into a profile."""
