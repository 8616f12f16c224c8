"""Expectations computed from the models, without a run."""
