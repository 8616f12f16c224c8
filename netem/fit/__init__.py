"""Fits of the emulator's models to recorded delays and losses: pure functions of arrays."""
