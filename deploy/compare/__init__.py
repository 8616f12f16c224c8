"""`tis compare`: estimators side by side on the same arrivals, over trials, seeds and networks."""
