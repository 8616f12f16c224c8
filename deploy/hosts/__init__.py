"""Hosts as a user starts them: `tis up` and `tis collect`."""
