"""CPU quota of this process's control group: cgroup v2's cpu.max, and how often the group was throttled.

Source: the kernel's Documentation/admin-guide/cgroup-v2.rst. The limits of a group and of all its ancestors apply, to
ordinary scheduling only: real-time threads are not throttled.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from common.units import NS_PER_US

_ROOT: Final = Path("/sys/fs/cgroup")
_OWN: Final = Path("/proc/self/cgroup")


class Quota(NamedTuple):
    """Quota of a group in processors, and its counters; the throttled time is summed over processors."""

    processors: float
    n_periods: int
    n_throttled: int
    throttled_ns: int


def parse_quota(cpu_max: str, cpu_stat: str) -> Quota | None:
    """Return the quota from the texts of a group's two files; None without a quota. Oracle: literal texts."""
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
    """Return the quotas of this process's group and of its ancestors, by path."""
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
            continue  # the root group has no cpu.max, and a container does not see groups above its own
        if (quota := parse_quota(*texts)) is not None:
            found[str(group)] = quota
    return found


def held_back(before: Mapping[str, Quota], after: Mapping[str, Quota]) -> Quota | None:
    """Return the counts, between two readings, of the quota that throttled most often; of equal ones the tightest.

    None when no quota exists in both readings.
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
