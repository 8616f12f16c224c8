"""The network emulator: delay, jitter and loss between two Zenoh networks.

Folders, from the top layer down:

- `bridge`: the live emulator, and `__main__`, its process; the only effects;
- `control`: requests to a running emulator;
- `node`: the emulator in virtual time; `build`: links from a scenario;
- `link`: one direction, from an offered packet to a released one, with `link.queue`;
- `expected`: what a network asks for, computed without a run;
- `stages`: loss, delay, duplication, corruption, reordering, ordering;
- `conditions`: outages, joint states, timeline;
- `fit`: models fitted to a record;
- `draws`: random numbers in blocks.
"""
