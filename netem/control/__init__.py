"""Control of a running emulator: requests, their effect and their log records."""
