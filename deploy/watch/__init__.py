"""Live observation of a run by an additional client on both networks, invisible to the sides."""
