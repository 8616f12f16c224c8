"""Tables of the comparison, one of each measure: a row for each method."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from tis.deploy.present.numbers import number

Figures = Mapping[str, Any]
Table = tuple[list[str], list[list[str]]]
"""Head, and rows of texts."""

HZ_PER_KHZ: Final = 1000.0
NONE: Final = "-"


def exponent_text(law: Figures) -> str:
    """Return an exponent with its interval."""
    if law["low"] is None:
        return f"{law['exponent']:z.2f}"
    return f"{law['exponent']:z.2f} ({law['low']:z.2f} to {law['high']:z.2f})"


def rate_text(rate_hz: float) -> str:
    """Return a rate of ticks as text, from 10 kHz on in kHz."""
    return f"{rate_hz:.0f} Hz" if rate_hz < 10 * HZ_PER_KHZ else f"{rate_hz / HZ_PER_KHZ:.0f} kHz"


def detail_tables(methods: Sequence[Figures]) -> dict[str, Table]:
    """Return a table of each measure by its title; those that nothing was measured for have no rows."""
    return {
        "Ratio to hold by delay": _by(methods, "accuracy", lambda e: f"{e['delay_ms']:g} ms", _ratio),
        "Ratio to hold by loss": _by(methods, "loss", loss_head, _ratio),
        "Error by loss, over the method's own without loss": _by(methods, "loss", loss_head, _growth),
        "R² in %, x y z, by loss": _by(methods, "loss", loss_head, _r2),
        "Ratio to hold by noise": _by(methods, "noise", lambda e: f"{e['noise_mm']:g} mm", _ratio),
        "Error by noise, over the method's own without noise": _by(
            methods, "noise", lambda e: f"{e['noise_mm']:g} mm", _growth
        ),
        "Ratio to hold by noise, trained with the same noise": _by(
            methods, "noise_trained", lambda e: f"{e['noise_mm']:g} mm", _ratio
        ),
        "R² in %, x y z, by noise": _by(methods, "noise", lambda e: f"{e['noise_mm']:g} mm", _r2),
        "Ratio to hold by number of training trials": _by(methods, "data", lambda e: str(e["n_trials"]), _ratio),
        "Training, s of processor time, by number of training trials": _by(
            methods, "data", lambda e: str(e["n_trials"]), lambda e: number(e["train_s"])
        ),
        "Error after training on others, over that after training on the own person": _by(
            methods, "adaptability", lambda e: str(e["trained_on"]), lambda e: _interval(e["ratio"], e)
        ),
        "Reliability": _reliability(methods),
        "Steps": _steps(methods),
        "Exponents": _exponents(methods),
        "Ratio to hold by block rows": _by(methods, "size", lambda e: str(e["block_rows"]), _ratio),
    }


def _by(
    methods: Sequence[Figures],
    measure: str,
    head: Callable[[Figures], str],
    cell: Callable[[Figures], str],
) -> Table:
    """Return the table of one measure: a row for each method, a column for each of its settings."""
    heads = list(dict.fromkeys(head(entry) for figures in methods for entry in figures[measure]))
    rows = []
    for figures in methods:
        found = {head(entry): cell(entry) for entry in figures[measure]}
        if found:
            rows.append([str(figures["method"]), *(found.get(each, NONE) for each in heads)])
    return ["method", *heads], rows


def _reliability(methods: Sequence[Figures]) -> Table:
    head = [
        "method",
        "ratio to hold",
        "p50, mm",
        "p95, mm",
        "p99, mm",
        "largest, mm",
        "missing, %",
        "in 95 % regions, %",
    ]
    names = ("error_p50_mm", "error_p95_mm", "error_p99_mm", "error_p100_mm", "missing_pct", "coverage_pct")
    rows = [
        [str(figures["method"]), _ratio(entry), *(number(entry[name]) for name in names)]
        for figures in methods
        if (entry := figures["reliability"]) is not None
    ]
    return head, rows


def _steps(methods: Sequence[Figures]) -> Table:
    at_1_khz = ("at 1 kHz: p50, µs", "p99, µs", "ratio to hold")
    head = ["method", "p50, µs", "p99, µs", "highest rate, one hand", "both hands", *at_1_khz, "training, s"]
    rows = []
    for figures in methods:
        step = figures["step"]
        if step is not None:
            times = (number(step[name]) for name in ("p50_us", "p99_us"))
            rates = (NONE if step[name] is None else rate_text(step[name]) for name in ("rate_hz", "rate_both_hz"))
            rows.append(
                [str(figures["method"]), *times, *rates, *_at_1_khz(figures["fast"]), number(figures["training_s"])]
            )
    return head, rows


def _at_1_khz(found: Figures | None) -> tuple[str, str, str]:
    if found is None:
        return NONE, NONE, NONE
    return number(found["step_p50_us"]), number(found["step_p99_us"]), _ratio(found)


def _exponents(methods: Sequence[Figures]) -> Table:
    names = {
        "train_rows": "training by rows",
        "step_rows": "step by rows",
        "train_size": "training by block rows",
        "step_size": "step by block rows",
    }
    rows = []
    for figures in methods:
        laws = [figures["exponents"][name] for name in names]
        if any(law is not None for law in laws):
            rows.append([str(figures["method"]), *(NONE if law is None else exponent_text(law) for law in laws)])
    return ["method", *names.values()], rows


def loss_head(entry: Figures) -> str:
    """Return the words for a share that is lost."""
    return f"{entry['loss_pct']:g} %{' in bursts' if entry['bursts'] else ''}"


def _ratio(entry: Figures) -> str:
    return _interval(entry["ratio_to_hold"], entry)


def _growth(entry: Figures) -> str:
    growth = entry["growth"]
    return NONE if growth is None else _interval(growth["ratio"], growth)


def _r2(entry: Figures) -> str:
    return " ".join(NONE if value is None else f"{value:.1f}" for value in entry["r2_pct"])


def _interval(value: float | None, bounds: Figures) -> str:
    if value is None:
        return NONE
    return f"{value:.3f}" if bounds["low"] is None else f"{value:.3f} ({bounds['low']:.3f}-{bounds['high']:.3f})"
