"""How much of the processors a control group leaves this process: cgroup v2's cpu.max, and how often it held it back.

Source: the kernel's Documentation/admin-guide/cgroup-v2.rst. A group's own limit and those of all groups around it
hold. Ordinary scheduling only: threads that run in real time are not held back.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from common.units import NS_PER_US

_ROOT: Final = Path("/sys/fs/cgroup")
_OWN: Final = Path("/proc/self/cgroup")


class Quota(NamedTuple):
    """So many processors' time a group may use, and its counters; the time held back is that of all processors."""

    processors: float
    n_periods: int
    n_throttled: int
    throttled_ns: int


def parse_quota(cpu_max: str, cpu_stat: str) -> Quota | None:
    """Return the quota from a group's two files; None when it has none. Oracle: literal texts."""
    limit = cpu_max.split()
    if len(limit) != 2 or not all(word.isdigit() for word in limit) or not int(limit[1]):
        return None  # "max 100000"
    pairs = (line.split() for line in cpu_stat.splitlines())
    counts = {pair[0]: int(pair[1]) for pair in pairs if len(pair) == 2 and pair[1].isdigit()}
    return Quota(
        int(limit[0]) / int(limit[1]),
        counts.get("nr_periods", 0),
        counts.get("nr_throttled", 0),
        counts.get("throttled_usec", 0) * NS_PER_US,
    )


def read_quotas(root: Path = _ROOT, own: Path = _OWN) -> dict[str, Quota]:
    """Return the quotas of this process's group and of all around it, by path; none where there are none."""
    try:
        line = next(line for line in own.read_text().splitlines() if line.startswith("0::/"))
    except (OSError, StopIteration):
        return {}
    inner = Path(line.removeprefix("0::/"))
    found: dict[str, Quota] = {}
    for group in (inner, *inner.parents):
        try:
            texts = [(root / group / name).read_text() for name in ("cpu.max", "cpu.stat")]
        except OSError:
            continue  # the outermost group has no cpu.max, and a container sees no further than its own
        if (quota := parse_quota(*texts)) is not None:
            found[str(group)] = quota
    return found


def held_back(before: Mapping[str, Quota], after: Mapping[str, Quota]) -> Quota | None:
    """Return, of the quota that held back most often between two readings, its counts; the tightest if all did alike.

    None when there was none all the time.
    """
    changes = [
        Quota(
            after[group].processors,
            max(0, after[group].n_periods - one.n_periods),
            max(0, after[group].n_throttled - one.n_throttled),
            max(0, after[group].throttled_ns - one.throttled_ns),
        )
        for group, one in before.items()
        if group in after
    ]
    return max(changes, key=lambda one: (one.n_throttled / max(1, one.n_periods), -one.processors), default=None)
