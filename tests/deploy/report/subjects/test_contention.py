"""One clause, the largest cause first, by literal shares."""

from dataclasses import replace

import pytest

from tis.common.metrics.processor_shares import ProcessorShares
from tis.deploy.report.subjects.processors import contention_clause

CALM = ProcessorShares(
    wall_ns=10**10, processors="0-1", own=0.1, testbed=0.05, others=0.05, steal=0.0, idle=0.9, iowait=0.0,
    quota_processors=None, throttled=None, throttled_ns=None,
)  # fmt: skip
LEFT = ", though the processors were 40 % idle over the run: not for want of them"


@pytest.mark.parametrize(
    ("shares", "clause"),
    [
        (None, ""),
        (replace(CALM, idle=0.3, iowait=0.1), LEFT),
        (replace(CALM, idle=0.4, steal=None), LEFT),
        (replace(CALM, idle=0.4, steal=0.019), LEFT),
        (
            replace(CALM, idle=0.4, others=0.55),
            f"{LEFT}, unless in bursts of other programs (55 %)",
        ),
        (
            replace(CALM, idle=0.4, steal=0.26),
            "; meanwhile the virtual machine's host took 26 % of the processors' time",
        ),
        (replace(CALM, idle=0.15, others=0.8), "; meanwhile other programs used 80 % of the processors' time"),
        (
            replace(CALM, idle=0.1, others=0.49, steal=0.26, testbed=0.15),
            "; meanwhile other programs used 49 % of the processors' time, the virtual machine's host took 26 % and "
            "tis itself used 15 %",
        ),
        (
            replace(CALM, idle=0.02, own=1.9, testbed=0.95, others=0.03),
            "; meanwhile tis itself used 95 % of the processors' time",
        ),
        (
            replace(CALM, idle=0.5, own=0.98, testbed=0.49, others=0.01),
            "; meanwhile the processors were 50 % idle over the run, but netem itself used 98 % of one",
        ),
        (
            replace(CALM, quota_processors=0.5, throttled=0.8, throttled_ns=10**9, steal=0.03),
            "; meanwhile a quota of 0.5 processors held netem back in 80 % of its periods and the virtual machine's "
            "host took 3 % of the processors' time",
        ),
        (replace(CALM, quota_processors=2.0, throttled=0.0, throttled_ns=0, idle=0.4), LEFT),
        (replace(CALM, idle=0.2, others=None, testbed=None, steal=None), ""),  # a side was killed: nobody can tell
        (replace(CALM, idle=None, iowait=None, others=None, testbed=None, steal=None), ""),
    ],
)
def test_the_clause(shares: ProcessorShares | None, clause: str) -> None:
    assert contention_clause(shares, "netem") == clause
