"""The network emulator: delay, jitter and loss between two Zenoh networks."""
