"""Fit of profiles to recorded traces and runs: `tis net fit`."""
