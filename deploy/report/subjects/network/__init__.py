"""The emulated network of a run: what was requested, what was decided, and what became of the packets."""
