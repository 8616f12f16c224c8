"""The live emulator between two Zenoh networks: all effects of `netem`."""
