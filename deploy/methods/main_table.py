"""The paper's table with a measured cell of each method beside the paper's words."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from tis.deploy.methods.claims import CLAIMS, FAMILY_TITLES, Feature
from tis.deploy.methods.merits import largest_growth, worst_loss, worst_noise
from tis.deploy.methods.tables import NONE, Table, loss_head, rate_text
from tis.deploy.present.numbers import number

Figures = Mapping[str, Any]


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
