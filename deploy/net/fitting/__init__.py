"""Profiles fitted to what was recorded: `tis net fit`."""
