"""The paper's table "Comparison of Different Methods for Remote Robotic Surgery in Tactile Internet", as printed."""

from typing import Final, Literal, NamedTuple

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
