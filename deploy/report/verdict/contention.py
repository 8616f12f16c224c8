"""Processor contention as the cause of a late process, in one clause."""

from typing import Final

from tis.common.channels import Side
from tis.common.metrics.processor_shares import ProcessorShares

_SCARCE: Final = 0.3
_MIN_USE: Final = 0.1
_MIN_STEAL: Final = 0.02
_MIN_THROTTLED: Final = 0.01
_ONE_BUSY: Final = 0.8


def contention_clause(shares: ProcessorShares | None, side: Side) -> str:
    """Return a clause that follows `starved` or `too busy`, the largest cause first; "" when nothing is known.

    ``shares`` are of ``side``'s processors. Steal time counts from 2 % on: a virtual machine's host takes it only
    from runnable processes, and for many ms at a time. A quota counts when it throttled 1 % of its periods. Other
    programs and the testbed itself count from 10 % on, and only when less than 30 % of the time was idle; otherwise
    they can interfere only in bursts, which shares of a whole run do not show. Oracle: literal shares,
    test_contention.
    """
    if shares is None:
        return ""
    if causes := _causes(shares, side):
        return f"; meanwhile {_listed(causes)}"
    unused = shares.unused
    if unused is None or unused < _SCARCE:
        return ""
    left = f"the processors were {_pct(unused)} idle over the run"
    if shares.own >= _ONE_BUSY:
        return f"; meanwhile {left}, but {side} itself used {_pct(shares.own)} of one"
    if shares.others is not None and shares.others >= _MIN_USE:
        return f", though {left}: not for want of them, unless in bursts of other programs ({_pct(shares.others)})"
    return f", though {left}: not for want of them"


def _causes(shares: ProcessorShares, side: Side) -> list[tuple[float, str, bool]]:
    """Return the causes, largest first: share, cause, and whether it is a share of processor time."""
    scarce = shares.unused is not None and shares.unused < _SCARCE
    found = [
        (shares.steal, "the virtual machine's host took", True, _MIN_STEAL),
        (shares.others if scarce else None, "other programs used", True, _MIN_USE),
        (shares.testbed if scarce else None, "tis itself used", True, _MIN_USE),
        (shares.throttled, f"a quota of {shares.quota_processors or 0:g} processors held {side} back in", False,
         _MIN_THROTTLED),
    ]  # fmt: skip
    causes = [
        (share, cause, of_time) for share, cause, of_time, lowest in found if share is not None and share >= lowest
    ]
    return sorted(causes, reverse=True)


def _listed(causes: list[tuple[float, str, bool]]) -> str:
    """Return the causes as a list that names their unit once."""
    texts, has_unit = [], False
    for share, cause, of_time in causes:
        of = " of its periods" if not of_time else "" if has_unit else " of the processors' time"
        has_unit = has_unit or of_time
        texts.append(f"{cause} {_pct(share)}{of}")
    *first, last = texts
    return f"{', '.join(first)} and {last}" if first else last


def _pct(share: float) -> str:
    return f"{100 * share:.0f} %"
