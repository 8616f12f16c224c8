"""Recorded networks: the send time of each message and its delay or loss, and the text formats that hold them.

Traces are CSV: lines ``# key: value`` about their origin, then a row for each message sent.

::

    # host: west
    # rate_hz: 1000
    sent_s,delay_ms
    0,12.25
    0.001,
    0.002,12.5

``delay_ms`` is empty where the message was lost. Further columns are ignored, as are lines above the column names
that begin with # but have no ``key: value``. Send times may count from any instant. Recorded opportunities to send
are in mahimahi's format: a line for each, its instant in whole ms.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.errors import DataError, Fault
from tis.common.units import NS_PER_MS, NS_PER_S, ms_to_ns, s_to_ns

LOST: Final = -1
MAX_DELAY_NS: Final = 3600 * NS_PER_S
MAX_SENT_NS: Final = 1_000_000 * NS_PER_S  # up to here a float of seconds resolves 1 ns

MAX_FAULTS: Final = 10


@dataclass(frozen=True, eq=False)
class Trace:
    """N >= 1 messages in the order of sending. Raises `DataError` for inconsistent columns.

    ``label`` names the trace in errors and reports; ``about`` describes its origin.
    """

    label: str
    sent_ns: NDArray[np.int64]
    """(N,), 0 to `MAX_SENT_NS`, not descending; only differences count."""
    delay_ns: NDArray[np.int64]
    """(N,), `LOST` where the message was lost, else 0 to `MAX_DELAY_NS`."""
    about: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        faults = _faults(self)
        if faults:
            raise DataError(faults)


class OpportunityTrace(Trace):
    """Recorded opportunities to send: their instants are the send times, and there are no delays."""


def truncated(label: str, faults: Sequence[Fault], n_faults: int) -> list[Fault]:
    """Return the first ten faults, and one that counts the remaining ones of ``n_faults``."""
    shown = list(faults[:MAX_FAULTS])
    left_out = n_faults - len(shown)
    return [*shown, Fault(label, "", f"... and {left_out} more")] if left_out > 0 else shown


def _faults(trace: Trace) -> list[Fault]:
    label, sent_ns, delay_ns = trace.label, trace.sent_ns, trace.delay_ns
    if sent_ns.shape != delay_ns.shape or sent_ns.ndim != 1:
        return [Fault(label, "", "must have as many delays as send times")]
    if not len(sent_ns):
        return [Fault(label, "", "must have at least one row")]
    falls = np.concatenate([[False], sent_ns[1:] < sent_ns[:-1]])
    checks = (
        ("sent_ns", f"must be between 0 and {MAX_SENT_NS}", (sent_ns < 0) | (sent_ns > MAX_SENT_NS), sent_ns),
        ("sent_ns", "must be at least that of the row before", falls, sent_ns),
        (
            "delay_ns",
            f"must be between 0 and {MAX_DELAY_NS}, or {LOST} where lost",
            (delay_ns < LOST) | (delay_ns > MAX_DELAY_NS),
            delay_ns,
        ),
    )
    found = [
        (int(row), Fault(label, f"row {row}: {column}", rule, int(values[row])))
        for column, rule, broken, values in checks
        for row in np.flatnonzero(broken)[:MAX_FAULTS]
    ]
    n_faults = sum(int(broken.sum()) for _, _, broken, _ in checks)
    return truncated(label, [fault for _, fault in sorted(found, key=lambda pair: pair[0])], n_faults)


_COLUMNS: Final = ("sent_s", "delay_ms")
_HEAD: Final = ",".join(_COLUMNS)
_MAX_LINE_CHARS: Final = 5_000
_MAX_ROWS: Final = 5_000_000  # an hour at 1 kHz has 3.6 million
_MAX_HEAD_LINES: Final = 1_000
_NUMBER: Final = r"[+-]?(?:\d{1,30}(?:\.\d{0,30})?|\.\d{1,30})(?:[eE][+-]?\d{1,3})?"
_ROW: Final = re.compile(rf"[ \t]*({_NUMBER})[ \t]*,[ \t]*({_NUMBER})?[ \t]*(?:,.*)?", re.ASCII)
_ABOUT: Final = re.compile(r"#[ \t]*([a-z][a-z0-9_]*)[ \t]*:[ \t]*(.*)", re.ASCII)


def parse_trace(text: str, where: str) -> Trace:
    """Return the trace of a CSV text; ``where`` names it.

    Raises `DataError` with the first faults, line by line, and the number of the others. Oracle: `render_trace`, and
    bad texts (tests/common/test_trace).
    """
    parser = _Parser(where)
    # counted first: a text of empty lines takes many times its size as a list
    n_lines = text.count("\n") + 1
    if n_lines > _MAX_ROWS + _MAX_HEAD_LINES:
        raise DataError(Fault(where, "", f"must have at most {_MAX_ROWS} rows", n_lines))
    lines = text.removeprefix("\ufeff").split("\n")
    n_above = parser.read_head(lines)
    if n_above is not None:
        parser.read_rows(lines, n_above)
    if parser.n_faults:
        raise DataError(truncated(where, parser.faults, parser.n_faults))
    return Trace(where, np.array(parser.sent_ns, np.int64), np.array(parser.delay_ns, np.int64), parser.about)


def render_trace(trace: Trace, uncertainty_ns: NDArray[np.int64] | None = None) -> str:
    """Return the CSV text of a trace, exact to the ns. Oracle: `parse_trace`, and a text by hand.

    ``uncertainty_ns`` (N,), a bound on the error of each delay, becomes the column ``uncertainty_ms``.
    """
    lines = [f"# {key}: {_printable(value)}" for key, value in trace.about.items()]
    lines.append(_HEAD if uncertainty_ns is None else f"{_HEAD},uncertainty_ms")
    bounds = [None] * len(trace.sent_ns) if uncertainty_ns is None else uncertainty_ns.tolist()
    for sent_ns, delay_ns, off_ns in zip(trace.sent_ns.tolist(), trace.delay_ns.tolist(), bounds, strict=True):
        delay_ms = "" if delay_ns == LOST else _decimal(delay_ns, NS_PER_MS, 6)
        off_ms = "" if off_ns is None else f",{_decimal(off_ns, NS_PER_MS, 6)}"
        lines.append(f"{_decimal(sent_ns, NS_PER_S, 9)},{delay_ms}{off_ms}")
    return "\n".join(lines) + "\n"


@dataclass
class _Parser:
    """State of the parser: the columns, the header entries and the faults so far."""

    where: str
    faults: list[Fault] = field(default_factory=list)
    n_faults: int = 0
    about: dict[str, str] = field(default_factory=dict)
    sent_ns: list[int] = field(default_factory=list)
    delay_ns: list[int] = field(default_factory=list)

    def read_head(self, lines: Sequence[str]) -> int | None:
        """Read the lines down to the column names; return their number, None without column names."""
        for number, raw in enumerate(lines[:_MAX_HEAD_LINES], start=1):
            line = self._line(number, raw)
            if line is None or not line.strip():
                continue
            if not line.startswith("#"):
                if tuple(cell.strip() for cell in line.split(",")[:2]) == _COLUMNS:
                    return number
                self._fault(number, f"must name the columns: {_HEAD}", line)
                return None
            if match := _ABOUT.fullmatch(line):
                if match[1] in self.about:
                    self._fault(number, "must not repeat a key", match[1])
                self.about[match[1]] = match[2].strip()
        self._fault(None, f"must have a line that names the columns: {_HEAD}")
        return None

    def read_rows(self, lines: Sequence[str], n_above: int) -> None:
        """Read the rows below the column names."""
        if len(lines) - n_above > _MAX_ROWS + 1:  # split() returns an empty text after the last line
            self._fault(None, f"must have at most {_MAX_ROWS} rows", len(lines) - n_above)
            return
        for number, raw in enumerate(lines[n_above:], start=n_above + 1):
            line = self._line(number, raw)
            if line is None or not line.strip():
                continue
            match = _ROW.fullmatch(line)
            if match is None:
                self._fault(number, f"must be two finite numbers, {_HEAD}, the second empty where lost", line)
                continue
            self._row(number, float(match[1]), None if match[2] is None else float(match[2]))
        if not self.n_faults and not self.sent_ns:
            self._fault(None, "must have at least one row")
        elif not self.n_faults and all(delay_ns == LOST for delay_ns in self.delay_ns):
            self._fault(None, "must have a delay_ms in at least one row: all messages are lost")

    def _row(self, number: int, sent_s: float, delay_ms: float | None) -> None:
        if not 0 <= sent_s <= MAX_SENT_NS / NS_PER_S:
            self._fault(number, f"sent_s must be between 0 and {MAX_SENT_NS // NS_PER_S}", sent_s)
            return
        sent_ns = s_to_ns(sent_s)
        if self.sent_ns and sent_ns < self.sent_ns[-1]:
            before_s = self.sent_ns[-1] / NS_PER_S
            self._fault(number, f"sent_s must be at least {before_s:.9g}, that of the row before", sent_s)
        if delay_ms is not None and not 0 <= delay_ms <= MAX_DELAY_NS / NS_PER_MS:
            self._fault(number, f"delay_ms must be between 0 and {MAX_DELAY_NS // NS_PER_MS}", delay_ms)
            return
        self.sent_ns.append(sent_ns)
        self.delay_ns.append(LOST if delay_ms is None else ms_to_ns(delay_ms))

    def _line(self, number: int, raw: str) -> str | None:
        """Return a line without its end, or None when it is too long or not printable."""
        if len(raw) > _MAX_LINE_CHARS:
            self._fault(number, f"must have at most {_MAX_LINE_CHARS} characters", len(raw))
            return None
        line = raw.removesuffix("\r")
        if not line.isprintable() and not line.replace("\t", " ").isprintable():
            self._fault(number, "must not have control characters", line)
            return None
        return line

    def _fault(self, number: int | None, rule: str, *got: object) -> None:
        self.n_faults += 1
        if len(self.faults) < MAX_FAULTS:
            self.faults.append(Fault(self.where, "" if number is None else f"line {number}", rule, *got))


def _decimal(whole: int, unit: int, digits: int) -> str:
    """Return ``whole / unit`` as an exact decimal without trailing zeros."""
    quotient, rest = divmod(whole, unit)
    return f"{quotient}.{rest:0{digits}}".rstrip("0").rstrip(".") if rest else str(quotient)


def _printable(value: str) -> str:
    """Return a value as one line, without characters that `parse_trace` refuses."""
    clean = "".join(letter if letter.isprintable() else " " for letter in value)
    return " ".join(clean.split())[: _MAX_LINE_CHARS // 2]


_MAX_OPPORTUNITIES: Final = 20_000_000
_LINE: Final = re.compile(r"[ \t]*(\d{1,15})[ \t]*", re.ASCII)


def parse_opportunities(text: str, where: str) -> OpportunityTrace:
    """Return the opportunities of a text; ``where`` names it.

    Raises `DataError` with the first faults and the number of the others. Oracle: mahimahi's rules, line by line,
    tests/common/test_trace.
    """
    n_lines = text.count("\n") + 1
    if n_lines > _MAX_OPPORTUNITIES:
        raise DataError(Fault(where, "", f"must have at most {_MAX_OPPORTUNITIES} lines", n_lines))
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
