"""Requests to a running emulator: `tis net show`, `set`, `outage`, `reset`."""
