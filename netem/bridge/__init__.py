"""The live emulator between two Zenoh networks; the only effects of `netem`."""
