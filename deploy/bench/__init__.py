"""Benchmarks: how fast the parts are on this machine, beside their peers."""
