"""Coupling of a hand and an arm that touches: what crosses the network, and what keeps it passive."""
