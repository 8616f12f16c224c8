"""Engine of a comparison: its units of work, computed by local processes or by the workers of a Dask cluster."""
