"""Export of a run as tables and trials."""
