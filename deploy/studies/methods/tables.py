"""The paper's table with a measured cell of each method beside the paper's words."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from tis.deploy.present.numbers import number
from tis.deploy.studies.methods.claims import CLAIMS, FAMILY_TITLES, Feature, largest_growth, worst_loss, worst_noise

# Tables of the comparison, one of each measure: a row for each method.

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


def main_table(methods: Sequence[Figures]) -> Table:
    """Return the paper's table: its features, its words on three families, and a measured cell of each method."""
    rows = [
        [claim.title, *claim.words.values(), *(CELLS[feature](figures) for figures in methods)]
        for feature, claim in CLAIMS.items()
    ]
    head = ["feature", *(f"paper: {title}" for title in FAMILY_TITLES.values())]
    return [*head, *(str(figures["method"]) for figures in methods)], rows


def _complexity(figures: Figures) -> str:
    laws = figures["exponents"]
    words = {"train_rows": "training: rows", "train_size": "size", "step_rows": "step: rows", "step_size": "size"}
    return ", ".join(f"{words[name]}^{laws[name]['exponent']:z.2f}" for name in words if laws[name]) or NONE


def _real_time(figures: Figures) -> str:
    step = figures["step"]
    if step is None:
        return NONE
    rate = "" if step["rate_hz"] is None else f"; up to {rate_text(step['rate_hz'])}"
    return f"{number(step['p50_us'])} µs, p99 {number(step['p99_us'])}{rate}"


def _at_worst(entry: Figures | None, what: str) -> str:
    if entry is None:
        return NONE
    growth = "" if entry["growth"] is None else f"error ×{entry['growth']['ratio']:.2f}, "
    return f"{what}: {growth}{entry['ratio_to_hold']:.3f} of hold's"


def _loss_cell(figures: Figures) -> str:
    entry = worst_loss(figures)
    return _at_worst(entry, "" if entry is None else loss_head(entry))


def _noise_cell(figures: Figures) -> str:
    entry, trained = worst_noise(figures), worst_noise(figures, "noise_trained")
    also = "" if trained is None else f"; trained with it {trained['ratio_to_hold']:.3f}"
    return NONE if entry is None else _at_worst(entry, f"{entry['noise_mm']:g} mm") + also


def _adaptability_cell(figures: Figures) -> str:
    entry = largest_growth(figures)
    return NONE if entry is None else f"error ×{entry['ratio']:.2f} ({entry['trained_on']})"


def _data_cell(figures: Figures) -> str:
    enough = figures["enough_trials"]
    return NONE if enough is None else "1 trial is enough" if enough == "1" else f"{enough} trials are enough"


def _scalability_cell(figures: Figures) -> str:
    step, law = figures["step"], figures["exponents"]["step_size"]
    both = (
        "" if step is None or step["rate_both_hz"] is None else f"both hands up to {rate_text(step['rate_both_hz'])}"
    )
    return ", ".join(filter(None, (both, "" if law is None else f"step: size^{law['exponent']:z.2f}"))) or NONE


def _training_cell(figures: Figures) -> str:
    return NONE if figures["training_s"] is None else f"{number(figures['training_s'])} s"


def _reliability_cell(figures: Figures) -> str:
    found = figures["reliability"]
    if found is None:
        return NONE
    covered = "" if found["coverage_pct"] is None else f", {found['coverage_pct']:.1f} % in 95 % regions"
    return f"p99 {number(found['error_p99_mm'])} mm, {found['missing_pct']:.3g} % missing{covered}"


def _applications_cell(figures: Figures) -> str:
    return " / ".join(f"{entry['ratio_to_hold']:.3f}" for entry in figures["accuracy"]) or NONE


CELLS: Final[dict[Feature, Callable[[Figures], str]]] = {
    "complexity": _complexity,
    "real_time": _real_time,
    "packet_loss": _loss_cell,
    "adaptability": _adaptability_cell,
    "data": _data_cell,
    "scalability": _scalability_cell,
    "noise": _noise_cell,
    "training_time": _training_cell,
    "reliability": _reliability_cell,
    "applications": _applications_cell,
}
