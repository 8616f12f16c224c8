"""Fitting the emulator's models to what was recorded: pure functions of arrays, each the inverse of a model."""
