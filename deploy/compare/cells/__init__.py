"""Cells of a comparison: one twin each, its scores, and the store of the results."""
