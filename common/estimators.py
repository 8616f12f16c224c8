"""The estimators, one row each: code, fit, look and words. Whoever lists estimators reads them here.

A new estimator is its code in `tis.patient_side.estimators` and its row. A model of its own adds its fields in
`tis.patient_side.statespace`, their schema in `movement_models`, and its fit in `identification.companions`. Rows
name code by its place, which is imported when an estimator is built: filters on filterpy take longer to load than
all else, and a scenario or a report needs only names and looks.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

Hue = Literal["VERMILION", "GREEN", "PINK", "VIOLET", "BROWN", "BLUE", "AMBER"]
"""Names of tones in `tis.deploy.present.palette`."""
Dash = Literal["solid", "dashed", "dotted", "dashdot"]

OF_PAPER: Final = "tis paper"
OF_METHODS: Final = "tis paper --methods"


@dataclass(frozen=True, kw_only=True)
class EstimatorRow:
    """An estimator: its code, the fit of its model, the style of its lines, and what it is good for.

    Attributes
    ----------
    code
        What builds it, as ``module:name`` in `tis.patient_side.estimators`.
    hue, dash
        The style of its lines in all figures; no two estimators look alike.
    words
        What it is good for, and its limits, for builders of surgical robots.
    judged_by
        The study that judges it, where it is a method to compare with: a scenario names it like one's own,
        ``tis.patient_side.estimators:name``.
    of_model
        Whether the code takes an arm's models, and raises `DataError` where the arm lacks its own.
    fit
        Function of `tis.patient_side.identification.companions` that fits its models; "" without any.
    slow
        Whether the fit takes several seconds, and is not tried for user-defined estimators.
    fitted_with
        The estimator whose model it uses, where it has none of its own.
    learned
        Whether its model is trained, which takes minutes: only where it is named. The code takes its name first.
    benched
        Whether `tis bench estimators` measures its steps.
    """

    code: str
    hue: Hue
    dash: Dash = "solid"
    words: str = ""
    judged_by: str = ""
    of_model: bool = True
    fit: str = ""
    slow: bool = False
    fitted_with: str | None = None
    learned: bool = False
    benched: bool = False


_LEARNED_HUES: Final[dict[str, Hue]] = {
    "gpr": "GREEN",
    "srlsmf": "PINK",
    "srlsmf_l1": "VERMILION",
    "transformer": "VIOLET",
    "informer": "AMBER",
    "cnn": "BLUE",
}
ESTIMATORS: Final[Mapping[str, EstimatorRow]] = MappingProxyType(
    {
        "hold": EstimatorRow(
            code="simple:Hold",
            hue="VERMILION",
            of_model=False,
            benched=True,
            words="The arm is where its freshest sample, by source stamp, saw it; without any model this is "
            "what one has. It is the yardstick, and hard to beat by much when the hand rests or when the "
            "network is faster than the hand.",
        ),
        "hold_last_arrived": EstimatorRow(
            code="simple:HoldLastArrived",
            hue="VERMILION",
            dash="dashed",
            of_model=False,
            judged_by=OF_PAPER,
        ),
        "static_gain": EstimatorRow(
            code="simple:StaticGain",
            hue="GREEN",
            judged_by=OF_PAPER,
        ),
        "velocity": EstimatorRow(
            code="simple:Velocity",
            hue="PINK",
            dash="dashed",
            of_model=False,
            judged_by=OF_PAPER,
        ),
        "damped_velocity": EstimatorRow(
            code="simple:DampedVelocity",
            hue="PINK",
            benched=True,
            words="The arm goes on as it went, but ever slower, as hands do; how fast it slows down is fitted "
            "to training movement. Two numbers to train, no way to become unstable, and under a constant "
            "delay most of the possible gain; under delays that jump about it gets far less, because it "
            "knows the speed only from neighbours. The simple choice for a calm network.",
        ),
        "moesp_kf": EstimatorRow(
            code="moesp_kf:MoespKf",
            hue="VIOLET",
            benched=True,
            words="A Kalman filter on the model from command to arm that MOESP identifies, with missing "
            "commands continued by damped velocity. The choice for arms with dynamics of their own (a "
            "servo, a lag) between command and motion where it must be a model that MOESP finds; of an arm "
            "that follows at once it knows little more than damped velocity.",
        ),
        "n4sid_kf": EstimatorRow(
            code="moesp_kf:n4sid_kf",
            hue="VIOLET",
            dash="dashed",
            fit="fit_n4sid",
            benched=True,
            judged_by=OF_METHODS,
        ),
        "arx_kf": EstimatorRow(
            code="moesp_kf:arx_kf",
            hue="BROWN",
            fit="fit_arx_models",
            benched=True,
            words="A filter on a least-squares regression, the kind of model that came before subspace methods "
            "here: on past commands and positions, or, where commands say nothing of the future, on the "
            "arm's own past. Quick to train and easy to explain; noise in the positions biases it.",
        ),
        "innovations_kf": EstimatorRow(
            code="adaptive_kf:AdaptiveKf",
            hue="BLUE",
            fit="fit_movement",
            benched=True,
            words="A Kalman filter on a model of how hands move by themselves (stochastic MOESP in innovations "
            "form), which adapts to the hand. The movement is the same in every direction unless the data clearly "
            "say otherwise, about a level that is free to drift, predicted by the real age of the freshest sample, "
            "and corrected by what training showed of speed, braking, gripper, the recent path and the recorder's "
            "clock. Of an arm that lags behind its command it is the command that it forecasts, and the arm's "
            "response to it that it runs. The default: accurate at every delay and in outages, whether the "
            "arm follows at once or lags, quick enough for 1 kHz, and with an uncertainty that can be believed: "
            "while it runs it compares its forecasts with what then came, lengthens or shortens them for this "
            "hand, and widens or narrows its ellipsoids until 95 % lie within.",
        ),
        "direct_ls": EstimatorRow(
            code="direct_ls:direct_ls",
            hue="AMBER",
            fit="fit_horizons",
            benched=True,
            judged_by=OF_METHODS,
        ),
        "drmf": EstimatorRow(
            code="drmf:drmf",
            hue="GREEN",
            dash="dotted",
            fit="fit_completion",
            slow=True,
            benched=True,
            judged_by=OF_METHODS,
        ),
        "paper": EstimatorRow(
            code="paper:paper",
            hue="BROWN",
            dash="dashed",
            fit="fit_paper",
            judged_by=OF_PAPER,
        ),
        "paper_as_printed": EstimatorRow(
            code="paper_as_printed:paper_as_printed",
            hue="AMBER",
            dash="dashed",
            fitted_with="paper",
            judged_by=OF_PAPER,
        ),
        **{
            name: EstimatorRow(
                code="learned_forecast:learned_forecast",
                hue=hue,
                dash="dashdot",
                fitted_with="innovations_kf",
                learned=True,
                judged_by=OF_METHODS,
            )
            for name, hue in _LEARNED_HUES.items()
        },
    }
)
NAMES: Final = tuple(name for name, row in ESTIMATORS.items() if not row.judged_by)
"""The estimators that scenarios name without a module."""
LEARNED: Final = tuple(name for name, row in ESTIMATORS.items() if row.learned)

_STUDIED: Final = "tis.patient_side.estimators:"
_FORMER: Final = {"adaptive_kf": "innovations_kf"}


def short_name(name: str) -> str:
    """Return the name of an estimator's row for its name in a scenario; others are returned unchanged."""
    return name.removeprefix(_STUDIED) if name.removeprefix(_STUDIED) in ESTIMATORS else name


def scenario_name(name: str) -> str:
    """Return the name in a scenario of the estimator with the row ``name``."""
    return f"{_STUDIED}{name}" if ESTIMATORS[name].judged_by else name


def users_of_fit(name: str) -> tuple[str, ...]:
    """Return the estimator called ``name`` and those that use its models."""
    return (name, *(other for other, row in ESTIMATORS.items() if row.fitted_with == name))


def successor(name: str) -> str | None:
    """Return the estimator that does what the one of a former name did; None for any other name."""
    return _FORMER.get(name.removeprefix(_STUDIED))
