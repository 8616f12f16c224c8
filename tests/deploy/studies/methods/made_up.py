"""Figures of methods written by hand, as `tis.deploy.studies.methods.figures.figures_of` returns them."""

from typing import Any


def scores(ratio: float, low: float | None = None, high: float | None = None) -> dict[str, Any]:
    return {
        "ratio_to_hold": ratio,
        "low": low,
        "high": high,
        "rmse_3d_mm": 4 * ratio,
        "r2_pct": [90.0, None, 95.0],
        "n_people": 1 if low is None else 4,
    }


def growth(ratio: float, low: float | None = None, high: float | None = None) -> dict[str, Any]:
    return {"ratio": ratio, "low": low, "high": high, "n_people": 1 if low is None else 4}


def law(exponent: float, low: float | None = None, high: float | None = None) -> dict[str, Any]:
    return {"exponent": exponent, "low": low, "high": high, "n": 5}


def figures(method: str, **changes: Any) -> dict[str, Any]:
    """Return the figures of a complete method; ``changes`` replace some of them."""
    made: dict[str, Any] = {
        "method": method,
        "gaps": [],
        "n_seeds": 1,
        "accuracy": [
            {"delay_ms": 100.0, **scores(0.4, 0.35, 0.45)},
            {"delay_ms": 500.0, **scores(0.8, 0.7, 0.9)},
        ],
        "loss": [
            {"loss_pct": 0.0, "bursts": False, **scores(0.4, 0.35, 0.45), "growth": growth(1.0, 1.0, 1.0)},
            {"loss_pct": 30.0, "bursts": False, **scores(0.5, 0.45, 0.55), "growth": growth(1.2, 1.1, 1.3)},
            {"loss_pct": 30.0, "bursts": True, **scores(0.6, 0.55, 0.65), "growth": growth(1.4, 1.3, 1.5)},
        ],
        "noise": [
            {"noise_mm": 0.0, **scores(0.4, 0.35, 0.45), "growth": growth(1.0, 1.0, 1.0)},
            {"noise_mm": 5.0, **scores(1.5, 1.4, 1.6), "growth": growth(4.0, 3.8, 4.2)},
        ],
        "noise_trained": [
            {"noise_mm": 0.0, **scores(0.4, 0.35, 0.45), "growth": growth(1.0, 1.0, 1.0)},
            {"noise_mm": 5.0, **scores(0.7, 0.6, 0.8), "growth": growth(2.0, 1.8, 2.2)},
        ],
        "reliability": {
            **scores(0.45, 0.4, 0.5),
            "error_p50_mm": 0.5,
            "error_p95_mm": 2.0,
            "error_p99_mm": 4.0,
            "error_p100_mm": 9.0,
            "missing_pct": 0.0,
            "coverage_pct": 94.0,
        },
        "data": [
            {"n_trials": "1", **scores(0.5, 0.45, 0.55), "n_rows": 1000.0, "train_s": 1.0},
            {"n_trials": "2", **scores(0.41, 0.36, 0.46), "n_rows": 2000.0, "train_s": 2.0},
            {"n_trials": "all", **scores(0.4, 0.35, 0.45), "n_rows": 9000.0, "train_s": 9.0},
        ],
        "enough_trials": "2",
        "adaptability": [
            {"trained_on": "other person", **growth(1.05, 1.0, 1.1)},
            {"trained_on": "Knot_Tying", **growth(1.3, 1.2, 1.4)},
        ],
        "training_s": 9.0,
        "step": {"p50_us": 5.0, "p99_us": 8.0, "rate_hz": 120_000.0, "rate_both_hz": 60_000.0, "n_rounds": 5},
        "fast": {**scores(0.9), "step_p50_us": 7.0, "step_p99_us": 70.0},
        "size": [{"block_rows": 5, **scores(0.42), "step_p50_us": 4.0, "train_s": 1.0}],
        "exponents": {
            "train_rows": law(1.0, 0.9, 1.1),
            "step_rows": law(0.0, -0.01, 0.01),
            "train_size": law(2.0),
            "step_size": law(0.5, 0.4, 0.6),
        },
    }
    return made | changes


def hold() -> dict[str, Any]:
    """Return the figures of `hold`, which needs no training."""
    nothing = ("data", "adaptability", "size", "noise_trained")
    untrained: dict[str, Any] = {**{measure: [] for measure in nothing}, "enough_trials": None, "training_s": None}
    exponents = dict.fromkeys(("train_rows", "train_size", "step_rows", "step_size"))
    each = [{"delay_ms": at, **scores(1.0, 1.0, 1.0)} for at in (100.0, 500.0)]
    return figures("hold", accuracy=each, exponents=exponents, **untrained)


def report(*methods: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """Return a report on the methods."""
    made: dict[str, Any] = {
        "command": "tis paper --methods --seed 7",
        "quick": False,
        "trials": {
            "task": "Suturing",
            "names": ["C001", "D002"],
            "people": ["C", "D"],
            "elsewhere": {"Knot_Tying": ["C002"]},
            "synthetic": False,
        },
        "extent": {},
        "settings": {"delay_ms": 100.0, "mean_burst": 8.0, "delays": "100 / 500"},
        "methods": list(methods),
        "absent": [],
        "verdicts": {},
    }
    return made | changes
