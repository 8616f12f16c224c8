"""The paper's table "Comparison of Different Methods for Remote Robotic Surgery in Tactile Internet".

A row is declared once: the paper's words, the measured cell of a method, its merit, and what is found of the paper's
own method.
"""

from collections.abc import Callable, Iterator
from typing import Final, Literal, NamedTuple

from tis.deploy.studies.methods import findings, measured
from tis.deploy.studies.methods.measured import Figures, Merit

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
        findings.complexity,
        is_exponent=True,
    ),
    "real_time": Claim(
        "Real-Time Performance",
        _said("High", "Moderate", "Limited"),
        measured.real_time_cell,
        lambda figures: measured.plain((figures["step"] or {}).get("p99_us")),
        "p99 of a step",
        findings.real_time,
        "µs",
    ),
    "packet_loss": Claim(
        "Handling Packet Loss",
        _said("Robust", "Moderate", "Sensitive"),
        measured.loss_cell,
        lambda figures: measured.ratio_of(measured.worst_loss(figures)),
        "error over hold's at the greatest loss",
        findings.packet_loss,
    ),
    "adaptability": Claim(
        "Adaptability",
        _said("High", "Low", "Limited"),
        measured.adaptability_cell,
        lambda figures: measured.ratio_of(measured.largest_growth(figures), "ratio"),
        "largest error after training on others over that on the own person",
        findings.adaptability,
    ),
    "data": Claim(
        "Data Requirements",
        _said("Moderate", "High", "High"),
        measured.data_cell,
        measured.enough_trials,
        "training trials that are enough",
        findings.data,
    ),
    "scalability": Claim(
        "Scalability",
        _said("Excellent", "Moderate", "Challenging"),
        measured.scalability_cell,
        measured.exponent_of("step_size"),
        "exponent of a step's time against block rows",
        findings.scalability,
        is_exponent=True,
    ),
    "noise": Claim(
        "Robustness to Noise",
        _said("Excellent", "Moderate", "Limited"),
        measured.noise_cell,
        lambda figures: measured.ratio_of(measured.worst_noise(figures, "noise_trained")),
        "error over hold's at the greatest noise, trained with it",
        findings.noise,
    ),
    "training_time": Claim(
        "Training Time",
        _said("Minimal", "Significant", "Considerable"),
        measured.training_cell,
        lambda figures: measured.plain(figures["training_s"]),
        "training",
        findings.training_time,
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
        findings.reliability,
        "mm",
    ),
    "applications": Claim(
        "Real-World Applications",
        _said("Ideal for Tactile Internet", "Limited", "Theoretical Focus"),
        measured.applications_cell,
        measured.mean_ratio,
        "error over hold's, mean of the delays",
        findings.applications,
    ),
}
"""The rows. Oracle: figures written by hand, test_verdicts and test_page."""
