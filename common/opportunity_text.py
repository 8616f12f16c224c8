"""Text format of mahimahi's packet-delivery traces: a line for each opportunity to send, its instant in whole ms."""

import re
from typing import Final

import numpy as np

from tis.common.errors import DataError, Fault
from tis.common.trace import MAX_FAULTS, MAX_SENT_NS, OpportunityTrace, truncated
from tis.common.units import NS_PER_MS

_MAX_ROWS: Final = 20_000_000
_LINE: Final = re.compile(r"[ \t]*(\d{1,15})[ \t]*", re.ASCII)


def parse_opportunities(text: str, where: str) -> OpportunityTrace:
    """Return the opportunities of a text; ``where`` names it.

    Raises `DataError` with the first faults and the number of the others. Oracle: mahimahi's rules, line by line,
    tests/common/test_opportunity_text.
    """
    n_lines = text.count("\n") + 1
    if n_lines > _MAX_ROWS:
        raise DataError(Fault(where, "", f"must have at most {_MAX_ROWS} lines", n_lines))
    lines = text.removesuffix("\n").split("\n") if text.strip() else []
    at_ms: list[int] = []
    faults: list[Fault] = []
    n_faults = 0
    for number, line in enumerate(lines, start=1):
        match = _LINE.fullmatch(line.removesuffix("\r"))
        rule = None
        if match is None:
            rule = "must be a number of whole ms"
        elif int(match[1]) * NS_PER_MS > MAX_SENT_NS:
            rule = f"must be at most {MAX_SENT_NS // NS_PER_MS}"
        elif at_ms and int(match[1]) < at_ms[-1]:
            rule = "must be at least that of the line before"
        if rule is None:
            at_ms.append(int(match[1]))  # type: ignore[index]
            continue
        n_faults += 1
        if len(faults) < MAX_FAULTS:
            faults.append(Fault(where, f"line {number}", rule, line[:80]))
    if not n_faults and (not at_ms or at_ms[-1] == 0):
        faults, n_faults = (
            [Fault(where, "", "must have an opportunity later than 0 ms, for it repeats from there")],
            1,
        )
    if n_faults:
        raise DataError(truncated(where, faults, n_faults))
    at_ns = np.array(at_ms, np.int64) * NS_PER_MS
    return OpportunityTrace(where, at_ns, np.zeros(len(at_ns), np.int64))
