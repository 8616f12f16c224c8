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
    words: str
    of_model: bool = True
    fit: str = ""
    slow: bool = False
    fitted_with: str | None = None
    learned: bool = False
    benched: bool = False


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
            words="The arm is where the packet that came in last saw it, however old that is: what a receiver "
            "does that does not look at time stamps. Where packets overtake each other it jumps back in "
            "time, and any other choice is better.",
        ),
        "static_gain": EstimatorRow(
            code="simple:StaticGain",
            hue="GREEN",
            words="The freshest command, scaled as the identified model says, and shifted as the freshest pair "
            "of command and position shows where a gain is all that relates them. It helps where commands "
            "come sooner than arm positions (topology `observer`), and takes an arm that lags for one "
            "that is there.",
        ),
        "velocity": EstimatorRow(
            code="simple:Velocity",
            hue="PINK",
            dash="dashed",
            of_model=False,
            words="The arm goes on with the speed of its last two samples until something newer comes. Good for "
            "delays of a few samples; for longer ones it overshoots at each turn of the hand, worse than "
            "holding.",
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
            words="The same filter on a model that N4SID identifies, which finds the states by an oblique "
            "projection. Take it to see whether a result hangs on the identification method: on good data "
            "it should not.",
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
            "form), the same movement in every direction unless the data clearly say otherwise, about a "
            "level that is free to drift, predicted by the real age of the freshest sample, and corrected "
            "by what training showed of speed, braking, gripper, the recent path and the recorder's "
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
            words="For each horizon a least-squares regression of its own, from the recent past straight to the "
            "position after that delay. About as accurate as a filter at its horizons, without a state "
            "that could go wrong; gaps in the recent past cost it more than they cost a filter.",
        ),
        "drmf": EstimatorRow(
            code="drmf:drmf",
            hue="GREEN",
            dash="dotted",
            fit="fit_completion",
            slow=True,
            benched=True,
            words="Direct robust matrix factorisation of the arm's recent positions, as a Hankel matrix: what "
            "is late or lost is a gap that a low-rank part fills, and single wrong positions go to a "
            "sparse part. Gaps cost it little, as every column is fitted to what has arrived; but it "
            "reads no commands, which stand in for lost positions in the filters. It factorises anew at "
            "each tick, which takes twenty times as long as a filter's step.",
        ),
        "paper": EstimatorRow(
            code="paper:paper",
            hue="BROWN",
            dash="dashed",
            fit="fit_paper",
            words="The Kalman filter of the paper that this testbed goes back to, with its update repaired so "
            "that all three axes are assimilated. It takes a late sample for a present one and drops the "
            "direct term of the model: here for comparison, not for use.",
        ),
        "paper_as_printed": EstimatorRow(
            code="paper_as_printed:paper_as_printed",
            hue="AMBER",
            dash="dashed",
            fitted_with="paper",
            words="The same algorithm to the letter: each axis starts again from the prediction, so that only "
            "the last axis is corrected and the others drift away. It shows what the printed algorithm "
            "does.",
        ),
        "gpr": EstimatorRow(
            code="learned_forecast:learned_forecast",
            hue="GREEN",
            dash="dashdot",
            fitted_with="innovations_kf",
            learned=True,
            words="A sparse Gaussian process adds to the linear forecast what training showed of the recent "
            "path, with 512 inducing points, for nine ages at once. It knows where it knows little, and "
            "says so in its uncertainty; each step compares the path with every point.",
        ),
        "srlsmf": EstimatorRow(
            code="learned_forecast:learned_forecast",
            hue="PINK",
            dash="dashdot",
            fitted_with="innovations_kf",
            learned=True,
            words="The same process on two thousand training rows, whose kernel matrix is a randomised low-rank "
            "part plus its largest other entries (SRLSMF, cited by the paper). It shows what more rows "
            "gain, and what they cost in each step.",
        ),
        "srlsmf_l1": EstimatorRow(
            code="learned_forecast:learned_forecast",
            hue="VERMILION",
            dash="dashdot",
            fitted_with="innovations_kf",
            learned=True,
            words="The same with all other entries shrunk instead of the largest ones kept: the l1 variant of "
            "that factorisation. Beside the other variant it shows whether the choice matters.",
        ),
        "transformer": EstimatorRow(
            code="learned_forecast:learned_forecast",
            hue="VIOLET",
            dash="dashdot",
            fitted_with="innovations_kf",
            learned=True,
            words="A small causal transformer adds to the linear forecast what the recent path of ten seconds "
            "tells, for any age, with a deviation of its own; trained on drawn losses and delays. It "
            "takes minutes to train and some hundred microseconds a step, and wants many people in its "
            "training.",
        ),
        "informer": EstimatorRow(
            code="learned_forecast:learned_forecast",
            hue="AMBER",
            dash="dashdot",
            fitted_with="innovations_kf",
            learned=True,
            words="The transformer with Informer's sparse attention and distilling, and with zeros for lost "
            "samples, as the authors of the paper plan. Where much is lost, zeros tell it less than "
            "interpolation tells the others.",
        ),
        "cnn": EstimatorRow(
            code="learned_forecast:learned_forecast",
            hue="BLUE",
            dash="dashdot",
            fitted_with="innovations_kf",
            learned=True,
            words="A small causal convolutional network with the same inputs and the same end. It is the "
            "quickest of the networks to train, and a good first choice among them.",
        ),
    }
)
LEARNED: Final = tuple(name for name, row in ESTIMATORS.items() if row.learned)


def users_of_fit(name: str) -> tuple[str, ...]:
    """Return the estimator called ``name`` and those that use its models."""
    return (name, *(other for other, row in ESTIMATORS.items() if row.fitted_with == name))
