"""Control of a running emulator: requests, their effect, their record."""
