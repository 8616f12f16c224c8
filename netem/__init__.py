"""The network emulator: delay, jitter and loss between two Zenoh networks.

Folders, from the top layer down:

- `__main__`: the process; `bridge`: the live emulator, with `bridge.mirrors`. Only these two have effects;
- `control`: requests to a running emulator, and their replay;
- `build`: the emulator of a scenario; `node`: the emulator in virtual time;
- `link`: one direction, from an offered packet to a released one, and its records, with `link.queue`;
- `expected`: figures and draws of a configured network, computed without a run;
- `stages`: loss, delay, duplication, corruption, reordering, ordering;
- `conditions`: outages, joint states, timeline;
- `fit`: models fitted to a record;
- `draws`: random numbers in blocks.
"""

from tis import refuse_old_name

refuse_old_name(__name__)
