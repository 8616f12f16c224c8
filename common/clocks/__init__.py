"""Comparison of two clocks: exchanges of timestamps, and a model fitted to them. Pure."""
