"""Kalman filters of an arm, in source time: what the estimators run on."""
