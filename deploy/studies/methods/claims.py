"""The paper's table "Comparison of Different Methods for Remote Robotic Surgery in Tactile Internet".

A row is declared once: the paper's words, the measured cell of a method, its merit, and what is found of the paper's
own method.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final, Literal, NamedTuple

from tis.deploy.present.numbers import number
from tis.deploy.studies.methods import measured
from tis.deploy.studies.methods.measured import OURS, Figures, Merit, is_useful
from tis.deploy.studies.methods.plans import HOLD

Family = Literal["kalman", "transformers", "gpr_drmf"]

FAMILY_TITLES: Final[dict[Family, str]] = {
    "kalman": "MOESP-based KF",
    "transformers": "Transformer Models",
    "gpr_drmf": "GPR and DRMF",
}
MEMBERS: Final[dict[Family, tuple[str, ...]]] = {
    "kalman": ("moesp_kf", "paper"),
    "transformers": ("transformer", "informer"),
    "gpr_drmf": ("gpr", "srlsmf", "srlsmf_l1", "drmf"),
}
"""Estimators of each family. The framework that the paper cites for GPR is `srlsmf`, with a sparse factorisation."""


class Claim(NamedTuple):
    """A row of the table.

    ``title`` and ``words`` are the paper's name of the feature and its words on each family of methods; ``cell`` is
    the measured cell of a method; ``merit`` the figure that is compared, None where it was not measured, with its
    meaning and unit; ``found`` yields sentences on the paper's own method, of which there is a merit.
    """

    title: str
    words: dict[Family, str]
    cell: Callable[[Figures], str]
    merit: Callable[[Figures], Merit | None]
    meaning: str
    found: Callable[[Figures], Iterator[str]]
    unit: str = ""
    is_exponent: bool = False


def _said(kalman: str, transformers: str, gpr_drmf: str) -> dict[Family, str]:
    return {"kalman": kalman, "transformers": transformers, "gpr_drmf": gpr_drmf}


CLAIMS: Final[dict[str, Claim]] = {
    "complexity": Claim(
        "Computational Complexity",
        _said("Low (O(n))", "Moderate to High (O(n^2 d) to O(n^3))", "High (O(n^3))"),
        measured.complexity_cell,
        measured.exponent_of("train_rows"),
        "exponent of the training time against rows",
        measured.complexity,
        is_exponent=True,
    ),
    "real_time": Claim(
        "Real-Time Performance",
        _said("High", "Moderate", "Limited"),
        measured.real_time_cell,
        lambda figures: measured.plain((figures["step"] or {}).get("p99_us")),
        "p99 of a step",
        measured.real_time,
        "µs",
    ),
    "packet_loss": Claim(
        "Handling Packet Loss",
        _said("Robust", "Moderate", "Sensitive"),
        measured.loss_cell,
        lambda figures: measured.ratio_of(measured.worst_loss(figures)),
        "error over hold's at the greatest loss",
        measured.packet_loss,
    ),
    "adaptability": Claim(
        "Adaptability",
        _said("High", "Low", "Limited"),
        measured.adaptability_cell,
        lambda figures: measured.ratio_of(measured.largest_growth(figures), "ratio"),
        "largest error after training on others over that on the own person",
        measured.adaptability,
    ),
    "data": Claim(
        "Data Requirements",
        _said("Moderate", "High", "High"),
        measured.data_cell,
        measured.enough_trials,
        "training trials that are enough",
        measured.data,
    ),
    "scalability": Claim(
        "Scalability",
        _said("Excellent", "Moderate", "Challenging"),
        measured.scalability_cell,
        measured.exponent_of("step_size"),
        "exponent of a step's time against block rows",
        measured.scalability,
        is_exponent=True,
    ),
    "noise": Claim(
        "Robustness to Noise",
        _said("Excellent", "Moderate", "Limited"),
        measured.noise_cell,
        lambda figures: measured.ratio_of(measured.worst_noise(figures, "noise_trained")),
        "error over hold's at the greatest noise, trained with it",
        measured.noise,
    ),
    "training_time": Claim(
        "Training Time",
        _said("Minimal", "Significant", "Considerable"),
        measured.training_cell,
        lambda figures: measured.plain(figures["training_s"]),
        "training",
        measured.training_time,
        "s",
    ),
    "reliability": Claim(
        "Reliability",
        _said("High", "Moderate", "Moderate"),
        measured.reliability_cell,
        lambda figures: measured.plain(
            None if figures["reliability"] is None else figures["reliability"]["error_p99_mm"]
        ),
        "p99 of the error",
        measured.reliability,
        "mm",
    ),
    "applications": Claim(
        "Real-World Applications",
        _said("Ideal for Tactile Internet", "Limited", "Theoretical Focus"),
        measured.applications_cell,
        measured.mean_ratio,
        "error over hold's, mean of the delays",
        measured.applications,
    ),
}
"""The rows. Oracle: figures written by hand, test_verdicts and test_page."""


# Verdicts on the adjectives of the paper: sentences chosen by rules from the figures.


Order = Literal["better", "worse", "not told apart"]

CLEARLY: Final = 0.05
"""Relative difference of merits from which one method is better."""
_WORDS: Final[dict[Order, str]] = {
    "better": "so the paper's order holds",
    "worse": "so the paper's order does not hold",
    "not told apart": "which cannot be told apart",
}


def order_of(one: Merit, other: Merit, is_exponent: bool = False) -> Order:
    """Return whether one merit is better than another, by the rule of this module. Oracle: test_verdicts."""
    size = 1.0 if is_exponent else max(abs(one.value), abs(other.value))
    if abs(one.value - other.value) <= CLEARLY * size:
        return "not told apart"
    first, second = (one, other) if one.value < other.value else (other, one)
    if first.high is not None and second.low is not None and first.high >= second.low:
        return "not told apart"
    return "better" if first is one else "worse"


def verdicts(methods: Sequence[Figures]) -> dict[str, str]:
    """Return the sentences on each row of the paper's table, by its title."""
    return {claim.title: verdict_of(claim, methods) for claim in CLAIMS.values()}


def verdict_of(claim: Claim, methods: Sequence[Figures]) -> str:
    """Return the sentences on one row of the table."""
    by_name = {str(figures["method"]): figures for figures in methods}
    merits = {name: merit for name, figures in by_name.items() if (merit := claim.merit(figures)) is not None}
    own = claim.found(by_name[OURS]) if OURS in merits else iter([f"Of `{OURS}` this was not measured."])
    rivals = {name: merit for name, merit in merits.items() if name != HOLD and is_useful(by_name[name])}
    sentences = [*own, *_beside(claim, merits), *_best(claim, rivals)]
    return f"The paper: *{claim.words['kalman']}*. {' '.join(sentences)}"


def _beside(claim: Claim, merits: Mapping[str, Merit]) -> Iterator[str]:
    """Yield how the paper's method stands to the best one of each other family."""
    ours = merits.get(OURS)
    for family, title in FAMILY_TITLES.items():
        if family == "kalman":
            continue
        said = f"{title} (the paper: {claim.words[family]})"
        found = {name: merits[name] for name in MEMBERS[family] if name in merits}
        if not found:
            yield f"{said}: not measured."
        elif ours is not None:
            best = min(found, key=lambda name: found[name].value)
            order = order_of(ours, found[best], claim.is_exponent)
            yield f"{said}: `{best}` has {_with_unit(found[best], claim)}, {_WORDS[order]}."


def _best(claim: Claim, found: Mapping[str, Merit]) -> Iterator[str]:
    """Yield which of all methods is best."""
    if len(found) < 2:
        return
    best = min(found, key=lambda name: found[name].value)
    equal = [
        f"`{name}`"
        for name in found
        if name != best and order_of(found[best], found[name], claim.is_exponent) == "not told apart"
    ]
    beside = f"; not told apart from it: {', '.join(equal)}" if equal else ""
    yield f"The smallest of all ({claim.meaning}) is that of `{best}`, {_with_unit(found[best], claim)}{beside}."


def _with_unit(merit: Merit, claim: Claim) -> str:
    return f"{number(merit.value)} {claim.unit}".strip()
