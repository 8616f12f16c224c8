"""One clause, the largest cause first, by literal shares."""

import pytest

from tis.deploy.report.subjects.processors import ProcessorFigures, contention_clause

CALM = ProcessorFigures(
    wall_s=10, processors="0-1", n_processors=2, own_pct=10, testbed_pct=5, others_pct=5, steal_pct=0, idle_pct=90,
    iowait_pct=0, quota_processors=None, throttled_pct=None, throttled_ms=None,
)  # fmt: skip


def replace(shares: ProcessorFigures, **changes: float | None) -> ProcessorFigures:
    """Return the shares with changes."""
    return shares.model_copy(update=changes)


LEFT = ", though the processors were 40 % idle over the run: not for want of them"


@pytest.mark.parametrize(
    ("shares", "clause"),
    [
        (None, ""),
        (replace(CALM, idle_pct=30, iowait_pct=10), LEFT),
        (replace(CALM, idle_pct=40, steal_pct=None), LEFT),
        (replace(CALM, idle_pct=40, steal_pct=1.9), LEFT),
        (
            replace(CALM, idle_pct=40, others_pct=55),
            f"{LEFT}, unless in bursts of other programs (55 %)",
        ),
        (
            replace(CALM, idle_pct=40, steal_pct=26),
            "; meanwhile the virtual machine's host took 26 % of the processors' time",
        ),
        (replace(CALM, idle_pct=15, others_pct=80), "; meanwhile other programs used 80 % of the processors' time"),
        (
            replace(CALM, idle_pct=10, others_pct=49, steal_pct=26, testbed_pct=15),
            "; meanwhile other programs used 49 % of the processors' time, the virtual machine's host took 26 % and "
            "tis itself used 15 %",
        ),
        (
            replace(CALM, idle_pct=2, own_pct=190, testbed_pct=95, others_pct=3),
            "; meanwhile tis itself used 95 % of the processors' time",
        ),
        (
            replace(CALM, idle_pct=50, own_pct=98, testbed_pct=49, others_pct=1),
            "; meanwhile the processors were 50 % idle over the run, but netem itself used 98 % of one",
        ),
        (
            replace(CALM, quota_processors=0.5, throttled_pct=80, throttled_ms=1000, steal_pct=3),
            "; meanwhile a quota of 0.5 processors held netem back in 80 % of its periods and the virtual machine's "
            "host took 3 % of the processors' time",
        ),
        (replace(CALM, quota_processors=2.0, throttled_pct=0, throttled_ms=0, idle_pct=40), LEFT),
        (
            replace(CALM, idle_pct=20, others_pct=None, testbed_pct=None, steal_pct=None),
            "",
        ),  # a side was killed
        (replace(CALM, idle_pct=None, iowait_pct=None, others_pct=None, testbed_pct=None, steal_pct=None), ""),
    ],
)
def test_the_clause(shares: ProcessorFigures | None, clause: str) -> None:
    assert contention_clause(shares, "netem") == clause
