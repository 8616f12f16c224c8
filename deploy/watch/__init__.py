"""A run as seen from outside while it lasts: one more client on both networks, which no side knows of."""
