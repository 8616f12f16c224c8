"""Verdicts: validity of a run, fidelity of its network, requirements of applications."""
