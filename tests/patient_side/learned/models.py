"""Learned models with drawn weights, of every method."""

from typing import Final, get_args

import numpy as np

from tis.common.scenario.estimator_names import LearnedName
from tis.patient_side.learned.gaussian_process import AGES, N_FEATURES
from tis.patient_side.learned.networks import NETWORKS
from tis.patient_side.learned_model import VERSION, LearnedModel, Singles, Training

LEARNED: Final[tuple[LearnedName, ...]] = get_args(LearnedName)
N_POINTS: Final = 5


def learned_model(method: LearnedName, seed: int = 0, size: float = 0.3) -> LearnedModel:
    """A model whose weights are normal, of deviation ``size``; positive where they must be."""
    rng = np.random.default_rng(seed)
    if method in NETWORKS:
        shapes = NETWORKS[method].shapes
    else:
        n_ages = len(AGES)
        shapes = {
            "points": (N_POINTS, N_FEATURES),
            "scale": (N_FEATURES,),
            "mean": (n_ages, N_POINTS, 3),
            "noise": (n_ages,),
        }
        if method == "gpr":
            shapes |= {"root": (N_POINTS, N_POINTS), "left": (n_ages, N_POINTS), "signal": (n_ages,)}
    weights: dict[str, Singles] = {
        name: (size * rng.normal(size=shape)).astype(np.float32) for name, shape in shapes.items()
    }
    for name in ("noise", "signal", "left"):
        if name in weights:
            weights[name] = np.tanh(np.abs(weights[name]))
    return LearnedModel(
        method=method,
        version=VERSION,
        usual_m=1e-3,
        gripper_spread_rad=0.5,
        scale_ages=np.array([1.0, 6.0, 30.0]),
        mean_share=np.array([1.0, 0.8, 0.5]),
        covariance_scale=np.array([[1.2, 1.5, 2.0], [1.0, 2.5, 3.0]]),
        weights=weights,
        training=Training(seed, 100, ("D",), 3, np.array([0.9, 0.8, 0.7])),
    )
