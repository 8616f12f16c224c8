"""What a run is measured by: pure functions of arrays; their results use the names of ``summary.json``."""
