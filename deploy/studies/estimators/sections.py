"""Sections of ``docs/research/estimators.md``: requests and their explanations."""

import os
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, get_args

from tis.common.runtime.recordings import list_trials
from tis.common.runtime.recordings.jigsaws import JIGSAWS_VARIABLE
from tis.common.scenario.estimator_names import EstimatorName, is_learned
from tis.common.scenario.source import JigsawsSource
from tis.deploy.compare.grid import Sweep
from tis.deploy.compare.plan import Request

NAMES: Final = get_args(EstimatorName)
_ADAPTIVE: Final = "adaptive_kf"
_COMPARED: Final = tuple(name for name in NAMES if name != _ADAPTIVE and not is_learned(name))
"""Estimators of the large tables; the adaptive one has tables of its own, the learned ones a page (`tis paper`)."""
_DELAYS: Final = Sweep("network.forward.delay.delay_ms", ("33", "100", "200", "500", "1000"))
_COPIES: Final = Sweep("surgeon.copies", ("1", "2", "4", "8"))
_SPACING: Final = Sweep("surgeon.copy_spacing_ms", ("0", "8", "33", "100"))
_HALF_LIFE: Final = Sweep("network.forward.correlation.half_life_s", ("0.01", "0.1", "1"))
_HISTORY: Final = Sweep("surgeon.history", ("0", "2", "8"))
_CONSTANT: Final = "network={forward: {delay: {kind: constant, delay_ms: 33}}}"
_WORST: Final = (
    "network={forward: {loss: {kind: bernoulli, p_loss: 0.01}, delay: {kind: uniform, low_ms: 200, high_ms: "
    "5000}, ordering: reorder}}"
)
_OUTAGES: Final = (
    "network={forward: {delay: {kind: constant, delay_ms: 30}}, outages: [{kind: alternating, down: {low_s: 0.5, "
    "high_s: 2}, up: {low_s: 2, high_s: 5}, direction: forward}]}"
)
_OUTAGE_LENGTHS: Final = Sweep("network.outages.0.down.high_s", ("1", "2"))
_CORRELATED: Final = "network.forward.correlation={half_life_s: 0.1}"
_LEARN: Final = "identification.train_samples=3600"
_PAPER: Final = "network.forward.ordering=reorder"
_READINGS: Final = {
    "ms": Sweep("network.profile", tuple(f"paper_{n}" for n in range(1, 6))),
    "samples": Sweep("network.profile", tuple(f"paper_{n}_samples" for n in range(1, 6))),
}
_RECORDED: Final = "source={kind: jigsaws, task: Suturing, hands: [left, right]}"
_UNITS: Final = {"ms": "milliseconds", "samples": "samples of 1/30 s"}
_LEFT_OUT: Final = ("static_gain", "n4sid_kf", "paper_as_printed")
"""Estimators left out of some sections, where they differ little from others, or much from all."""
_LAGGING: Final = "source.arm_bandwidth_hz=2"
_DURATION_S: Final = 60.0
_SEEDS: Final = 4


@dataclass(frozen=True)
class Section:
    """Section of the page: request and explanation.

    ``shows`` selects the tables besides errors and cost: gain and price of redundancy, the paper's printed figures,
    the error by age, the orientation methods instead of the estimators, or none.
    """

    title: str
    about: str
    request: Request
    shows: Literal["errors", "redundancy", "paper", "ages", "orientation"] = "redundancy"


def sections() -> list[Section]:
    """Return the page's sections: on synthetic movement, and on recorded trials if available."""
    synthetic = Request("default", (_LEARN,), n_seeds=_SEEDS, duration_s=_DURATION_S)
    found = [*_source_sections(synthetic, "synthetic"), *_lagging_arm_sections()]
    found.append(_adaptation_section(synthetic, "synthetic"))
    found.append(_orientation_section(synthetic, "synthetic"))
    if os.environ.get(JIGSAWS_VARIABLE):
        few = _one_of_each_person(list_trials(JigsawsSource(kind="jigsaws", task="Suturing")))
        recorded = Request("default", (_RECORDED,))
        found += _source_sections(recorded, "recorded suturing", few)
        found.append(_adaptation_section(recorded, "recorded suturing"))
        found.append(_orientation_section(recorded, "recorded suturing"))
        found += [_paper_rows_section(reading, sweep, few) for reading, sweep in _READINGS.items()]
    return found


def _one_of_each_person(trials: Sequence[str]) -> tuple[str, ...] | None:
    """Return the last trial of each person, as all trials would take hours; None without any."""
    return tuple({name[0]: name for name in trials}.values()) or None


def _lagging_arm_sections() -> list[Section]:
    def request(*more: str) -> Request:
        settings = (_LEARN, _CONSTANT, _LAGGING, *more)
        return Request("default", settings, _COMPARED, n_seeds=_SEEDS, duration_s=_DURATION_S, sweeps=(_DELAYS,))

    return [
        Section(
            "An arm that lags, synthetic",
            "The same hands, but the arm follows its command as a servo of 2 Hz does, some 110 ms behind it. So a "
            "command tells where the arm will be, and a model from command to arm is worth having: up to that lag "
            "nothing has to be foretold.",
            request(),
            shows="errors",
        ),
        Section(
            "An arm that lags, commands at once, synthetic",
            "The paper's topology, `observer`: who estimates sits with the surgeon, has every command at once, and "
            "only the arm's positions come so many ms late. With a good model they are hardly needed; what knows no "
            "commands must foretell all the same.",
            request("topology=observer"),
            shows="errors",
        ),
    ]


def _adaptation_section(source: Request, which: str) -> Section:
    settings, names = (*source.settings, _CONSTANT), ("hold", "innovations_kf", _ADAPTIVE)
    return Section(
        f"Adaptation while running, {which}",
        "`innovations_kf` beside `adaptive_kf`, which tracks the scales of velocity and noise. The ratio says "
        "whether these hands differ from the training's in how far they go on; what lies within the ellipsoid, "
        "whether they differ in how much they err.",
        replace(source, settings=settings, estimators=names, sweeps=(_DELAYS,)),
        shows="errors",
    )


def _orientation_section(source: Request, which: str) -> Section:
    return Section(
        f"Orientation and gripper, {which}",
        "The angle to the arm's true orientation, in degrees, of the orientation methods, which run beside the "
        "position estimators. `hold` repeats the newest sample, `constant_rate` turns on at a damped rate, and "
        "`tangent_ls` is least squares in the tangent space at the newest orientation.",
        replace(source, settings=(*source.settings, _CONSTANT), estimators=("hold",), sweeps=(_DELAYS,)),
        shows="orientation",
    )


def _paper_rows_section(reading: str, sweep: Sweep, trials: tuple[str, ...] | None) -> Section:
    names = ("hold", "damped_velocity", "moesp_kf", "innovations_kf", "paper", "paper_as_printed")
    settings = (_RECORDED, _PAPER)
    return Section(
        f"The paper's rows 1 to 5, delays read as {_UNITS[reading]}, recorded suturing",
        "The paper's figures are for the commands arriving undelayed (topology `observer`), on one trial, with its "
        "model found on rows of that very trial. Here everything that the surgeon sends crosses the network, and "
        "models are of other subjects. These delays are short beside how fast a hand moves: `hold` alone is above "
        "the paper's figures, so the rows tell its algorithm from others and hardly the others from each other. That "
        "its figures are R\u00b2 is inferred.",
        Request("default", settings, names, trials, sweeps=(sweep,)),
        shows="paper",
    )


def command_of(request: Request) -> str:
    """Return the command that repeats a request."""
    words = ["tis", "compare", request.scenario]
    options = {
        "--estimators": ",".join(request.estimators or ()),
        "--trials": ",".join(request.trials or ()),
        "--seeds": request.n_seeds,
        "--duration-s": None if request.duration_s is None else f"{request.duration_s:g}",
    }
    for option, value in options.items():
        words += [option, str(value)] if value else []
    for sweep in request.sweeps:
        words += ["--sweep", f"{sweep.path}={','.join(sweep.values)}"]
    words += ["--zip"] if request.zipped else []
    for setting in request.settings:
        words += ["--set", setting]
    return shlex.join(words)


def _source_sections(source: Request, which: str, trials: tuple[str, ...] | None = None) -> list[Section]:
    """Return the sections of one source; all but the first, which has every trial, use these ``trials``."""

    def request(network: tuple[str, ...], sweep: Sweep, names: Sequence[str]) -> Request:
        chosen = None if sweep is _DELAYS else trials
        settings = (*source.settings, *network)
        return replace(source, settings=settings, estimators=tuple(names), trials=chosen, sweeps=(sweep,))

    few = [name for name in _COMPARED if name not in _LEFT_OUT]
    constant = Section(
        f"Constant delay, {which}",
        "Everything that the surgeon sends comes so many ms late, and the position *now* is asked for. What the "
        "arm does meanwhile is the hand's own decision, which nobody can know: the ratio rises with the delay for "
        "everyone.",
        request((_CONSTANT,), _DELAYS, _COMPARED),
        shows="errors",
    )
    outages = Section(
        f"Outages, {which}",
        "A steady network, 30 ms, that falls silent for 0.5 s up to 1 or 2 s. The first table is by the age of the "
        "freshest sample. A forecast must fade into the last known position: one that runs on is soon worse than "
        "holding still.",
        request((_OUTAGES,), _OUTAGE_LENGTHS, few),
        shows="ages",
    )
    independent = Section(
        f"Several copies against random delay, {which}",
        "Each packet is late by something between 0.2 and 5 s, whatever the others are, and 1 % is lost: the "
        "paper's worst network. Of several copies the quickest counts, so the freshest sample that has arrived is "
        "much younger. Beside a good filter it buys about as much again, and its price is bandwidth.",
        request((_WORST,), _COPIES, few),
    )
    history = Section(
        f"History in each packet, {which}",
        "The same network, one copy of each sample, but the samples before it ride along. That brings no sample "
        "sooner than its own packet might come, so the freshest one is as old as before; but its neighbours are "
        "there, and with them the speed. As many packets, larger ones: for where packets cost more than bytes.",
        request((_WORST,), _HISTORY, few),
    )
    together = Section(
        f"Several copies against correlated delay, {which}",
        "The same delays, but a slow moment of the network lasts (half-life 0.1 s), as slow moments do. Copies that "
        "are sent at once share their fate: they cost as much as before and buy little.",
        request((_WORST, _CORRELATED), _COPIES, few),
    )
    spaced = Section(
        f"Four copies spaced in time, correlated delay, {which}",
        "Spread over the sample period, some 8 ms apart at 30 samples/s, the copies meet different moments of the "
        "network. Further apart they gain less: by the time they leave, a newer sample has left too.",
        request((_WORST, _CORRELATED, "surgeon.copies=4"), _SPACING, few),
    )
    lasting = Section(
        f"How long slow moments last, {which}",
        "Four copies, 8 ms apart. The shorter the network's slow moments, the younger the freshest sample; four "
        "copies on one path do not get round a moment that lasts for a second.",
        request((_WORST, "surgeon={copies: 4, copy_spacing_ms: 8}"), _HALF_LIFE, few),
    )
    return [constant, outages, independent, together, spaced, lasting, history]
