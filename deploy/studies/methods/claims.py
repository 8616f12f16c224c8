"""Merit of a method in each row of the paper's table: one number, with its interval where there is one."""

from collections.abc import Callable, Mapping
from typing import Any, Final, Literal, NamedTuple

from tis.deploy.studies.methods.plans import ALL

# The paper's table "Comparison of Different Methods for Remote Robotic Surgery in Tactile Internet", as printed.

Feature = Literal[
    "complexity",
    "real_time",
    "packet_loss",
    "adaptability",
    "data",
    "scalability",
    "noise",
    "training_time",
    "reliability",
    "applications",
]
Family = Literal["kalman", "transformers", "gpr_drmf"]


class Claim(NamedTuple):
    """One row: the paper's name of the feature, and its words on each family of methods."""

    title: str
    words: dict[Family, str]


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

OURS: Final = "moesp_kf"
"""The paper's method as the testbed builds it; `paper` is its Algorithm 1."""


def _claim(title: str, kalman: str, transformers: str, gpr_drmf: str) -> Claim:
    return Claim(title, {"kalman": kalman, "transformers": transformers, "gpr_drmf": gpr_drmf})


CLAIMS: Final[dict[Feature, Claim]] = {
    "complexity": _claim(
        "Computational Complexity", "Low (O(n))", "Moderate to High (O(n^2 d) to O(n^3))", "High (O(n^3))"
    ),
    "real_time": _claim("Real-Time Performance", "High", "Moderate", "Limited"),
    "packet_loss": _claim("Handling Packet Loss", "Robust", "Moderate", "Sensitive"),
    "adaptability": _claim("Adaptability", "High", "Low", "Limited"),
    "data": _claim("Data Requirements", "Moderate", "High", "High"),
    "scalability": _claim("Scalability", "Excellent", "Moderate", "Challenging"),
    "noise": _claim("Robustness to Noise", "Excellent", "Moderate", "Limited"),
    "training_time": _claim("Training Time", "Minimal", "Significant", "Considerable"),
    "reliability": _claim("Reliability", "High", "Moderate", "Moderate"),
    "applications": _claim("Real-World Applications", "Ideal for Tactile Internet", "Limited", "Theoretical Focus"),
}


Figures = Mapping[str, Any]


class Merit(NamedTuple):
    """A figure of which less is better; ``low`` and ``high`` are its 95 % interval, None where it has none."""

    value: float
    low: float | None = None
    high: float | None = None


def merit_of(feature: Feature, figures: Figures) -> Merit | None:
    """Return the merit of a method, None where it was not measured. Oracle: figures written by hand, test_merits."""
    return _MERITS[feature].of(figures)


def merit_words(feature: Feature) -> tuple[str, str]:
    """Return what the number is, and its unit."""
    return _MERITS[feature].words, _MERITS[feature].unit


def worst_loss(figures: Figures) -> Figures | None:
    """Return the entry of the greatest loss, in bursts rather than independent."""
    return max(figures["loss"], key=lambda entry: (entry["loss_pct"], entry["bursts"]), default=None)


def worst_noise(figures: Figures, measure: str = "noise") -> Figures | None:
    """Return the entry of the greatest noise, after training without noise or with it (``noise_trained``)."""
    return max(figures[measure], key=lambda entry: float(entry["noise_mm"]), default=None)


def largest_growth(figures: Figures) -> Figures | None:
    """Return the entry of the training on others after which the error is largest."""
    return max(figures["adaptability"], key=lambda entry: float(entry["ratio"]), default=None)


def _exponent(name: str) -> Callable[[Figures], Merit | None]:
    def merit(figures: Figures) -> Merit | None:
        law = figures["exponents"][name]
        return None if law is None else Merit(law["exponent"], law["low"], law["high"])

    return merit


def is_useful(figures: Figures) -> bool:
    """Tell whether a method errs less than hold, on average over the delays: otherwise no other merit counts."""
    ratio = _mean_ratio(figures)
    return ratio is None or ratio.value < 1.0


def _ratio_of(entry: Figures | None) -> Merit | None:
    return None if entry is None else Merit(entry["ratio_to_hold"], entry["low"], entry["high"])


def _plain(value: float | None) -> Merit | None:
    return None if value is None else Merit(float(value))


def _step_p99(figures: Figures) -> Merit | None:
    return _plain(None if figures["step"] is None else figures["step"]["p99_us"])


def _adaptability(figures: Figures) -> Merit | None:
    entry = largest_growth(figures)
    return None if entry is None else Merit(entry["ratio"], entry["low"], entry["high"])


def _enough(figures: Figures) -> Merit | None:
    """Return the number of trials that are enough; with all of them, one more than the largest number tried."""
    enough = figures["enough_trials"]
    tried = [int(entry["n_trials"]) for entry in figures["data"] if entry["n_trials"] != ALL]
    return _plain(None if enough is None else max(tried, default=0) + 1 if enough == ALL else int(enough))


def _p99_error(figures: Figures) -> Merit | None:
    return _plain(None if figures["reliability"] is None else figures["reliability"]["error_p99_mm"])


def _mean_ratio(figures: Figures) -> Merit | None:
    """Return the mean of the ratios to hold over the delays, and that of the bounds of their intervals."""
    each = figures["accuracy"]
    if not each:
        return None
    bounds = [
        None if any(entry[name] is None for entry in each) else sum(entry[name] for entry in each) / len(each)
        for name in ("low", "high")
    ]
    return Merit(sum(entry["ratio_to_hold"] for entry in each) / len(each), *bounds)


class _Kind(NamedTuple):
    words: str
    unit: str
    of: Callable[[Figures], Merit | None]


_MERITS: Final[dict[Feature, _Kind]] = {
    "complexity": _Kind("exponent of the training time against rows", "", _exponent("train_rows")),
    "real_time": _Kind("p99 of a step", "µs", _step_p99),
    "packet_loss": _Kind(
        "error over hold's at the greatest loss", "", lambda figures: _ratio_of(worst_loss(figures))
    ),
    "adaptability": _Kind("largest error after training on others over that on the own person", "", _adaptability),
    "data": _Kind("training trials that are enough", "", _enough),
    "scalability": _Kind("exponent of a step's time against block rows", "", _exponent("step_size")),
    "noise": _Kind(
        "error over hold's at the greatest noise, trained with it",
        "",
        lambda figures: _ratio_of(worst_noise(figures, "noise_trained")),
    ),
    "training_time": _Kind("training", "s", lambda figures: _plain(figures["training_s"])),
    "reliability": _Kind("p99 of the error", "mm", _p99_error),
    "applications": _Kind("error over hold's, mean of the delays", "", _mean_ratio),
}
