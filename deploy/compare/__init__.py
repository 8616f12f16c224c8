"""Command `tis compare`: estimators on the same arrivals, over trials, seeds and networks."""
