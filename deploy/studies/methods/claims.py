"""The paper's table "Comparison of Different Methods for Remote Robotic Surgery in Tactile Internet", row by row.

A row is declared once: the paper's words, the measured cell of a method, its merit, and what is found of the paper's
own method.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final, Literal, NamedTuple

from tis.deploy.present.numbers import NONE, number
from tis.deploy.studies.methods.plans import ALL

Figures = Mapping[str, Any]
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

OURS: Final = "moesp_kf"
"""The paper's method as the testbed builds it; `paper` is its Algorithm 1."""
HZ_PER_KHZ: Final = 1000.0
TICK_US: Final = 1000.0
"""Time between ticks at 1 kHz."""
_GROWTHS: Final = ((1.1, "hardly grows"), (1.5, "grows somewhat"), (3.0, "grows much"), (float("inf"), "multiplies"))
"""Words of an error's growth, each up to a ratio."""


class Merit(NamedTuple):
    """A figure of which less is better; ``low`` and ``high`` are its 95 % interval, None where it has none."""

    value: float
    low: float | None = None
    high: float | None = None


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


def exponent_text(law: Figures) -> str:
    """Return an exponent with its interval."""
    if law["low"] is None:
        return f"{law['exponent']:z.2f}"
    return f"{law['exponent']:z.2f} ({law['low']:z.2f} to {law['high']:z.2f})"


def rate_text(rate_hz: float) -> str:
    """Return a rate of ticks as text, from 10 kHz on in kHz."""
    return f"{rate_hz:.0f} Hz" if rate_hz < 10 * HZ_PER_KHZ else f"{rate_hz / HZ_PER_KHZ:.0f} kHz"


def loss_head(entry: Figures) -> str:
    """Return the words for a share that is lost."""
    return f"{entry['loss_pct']:g} %{' in bursts' if entry['bursts'] else ''}"


def growth_words(ratio: float) -> str:
    """Return the words for an error that has become ``ratio`` times as large."""
    return next(words for most, words in _GROWTHS if ratio <= most)


def is_useful(figures: Figures) -> bool:
    """Tell whether a method errs less than hold, on average over the delays: otherwise no other merit counts."""
    ratio = _mean_ratio(figures)
    return ratio is None or ratio.value < 1.0


def _plain(value: float | None) -> Merit | None:
    return None if value is None else Merit(float(value))


def _exponent(name: str) -> Callable[[Figures], Merit | None]:
    def merit(figures: Figures) -> Merit | None:
        law = figures["exponents"][name]
        return None if law is None else Merit(law["exponent"], law["low"], law["high"])

    return merit


def _ratio_of(entry: Figures | None, name: str = "ratio_to_hold") -> Merit | None:
    return None if entry is None else Merit(entry[name], entry["low"], entry["high"])


def _at_worst(entry: Figures | None, what: str) -> str:
    if entry is None:
        return NONE
    growth = "" if entry["growth"] is None else f"error ×{entry['growth']['ratio']:.2f}, "
    return f"{what}: {growth}{entry['ratio_to_hold']:.3f} of hold's"


def _complexity_cell(figures: Figures) -> str:
    laws = figures["exponents"]
    words = {"train_rows": "training: rows", "train_size": "size", "step_rows": "step: rows", "step_size": "size"}
    return ", ".join(f"{words[name]}^{laws[name]['exponent']:z.2f}" for name in words if laws[name]) or NONE


def _complexity(ours: Figures) -> Iterator[str]:
    law, step = ours["exponents"]["train_rows"], ours["exponents"]["step_rows"]
    low, high = (law["exponent"] if law[bound] is None else law[bound] for bound in ("low", "high"))
    beside = "what the paper's O(n) says, within the interval"
    beside = "more than the paper's O(n)" if low > 1.0 else "no more than the paper's O(n)" if high <= 1.0 else beside
    yield f"The time to train `{OURS}` grows with the training rows to the power {exponent_text(law)}: {beside}."
    if step is not None:
        yield f"The time of a step grows with them to the power {exponent_text(step)}."


def _real_time_cell(figures: Figures) -> str:
    step = figures["step"]
    if step is None:
        return NONE
    rate = "" if step["rate_hz"] is None else f"; up to {rate_text(step['rate_hz'])}"
    return f"{number(step['p50_us'])} µs, p99 {number(step['p99_us'])}{rate}"


def _real_time(ours: Figures) -> Iterator[str]:
    step = ours["step"]
    rate = "" if step["rate_hz"] is None else f"; its steps keep up with ticks at {rate_text(step['rate_hz'])}"
    times = f"{number(step['p50_us'])} µs at the median, {number(step['p99_us'])} at p99"
    yield f"A step of `{OURS}` takes {times}{rate}."


def _worst_loss(figures: Figures) -> Figures | None:
    """Return the entry of the greatest loss, in bursts rather than independent."""
    return max(figures["loss"], key=lambda entry: (entry["loss_pct"], entry["bursts"]), default=None)


def _loss_cell(figures: Figures) -> str:
    entry = _worst_loss(figures)
    return _at_worst(entry, "" if entry is None else loss_head(entry))


def _packet_loss(ours: Figures) -> Iterator[str]:
    entry = _worst_loss(ours)
    if entry is not None and entry["growth"] is not None:
        how = " in bursts" if entry["bursts"] else ""
        yield (
            f"With {entry['loss_pct']:g} % lost{how} the error of `{OURS}` {growth_words(entry['growth']['ratio'])} "
            f"({number(entry['growth']['ratio'])} times that without loss), and is {number(entry['ratio_to_hold'])} "
            f"of hold's, which suffers as well."
        )


def _largest_growth(figures: Figures) -> Figures | None:
    """Return the entry of the training on others after which the error is largest."""
    return max(figures["adaptability"], key=lambda entry: float(entry["ratio"]), default=None)


def _adaptability_cell(figures: Figures) -> str:
    entry = _largest_growth(figures)
    return NONE if entry is None else f"error ×{entry['ratio']:.2f} ({entry['trained_on']})"


def _adaptability(ours: Figures) -> Iterator[str]:
    entry = _largest_growth(ours)
    if entry is not None:
        yield (
            f"Trained on others ({entry['trained_on']}) the error of `{OURS}` {growth_words(entry['ratio'])}: "
            f"{number(entry['ratio'])} times that after training on the same person."
        )


def _enough(figures: Figures) -> Merit | None:
    """Return the number of trials that are enough; with all of them, one more than the largest number tried."""
    enough = figures["enough_trials"]
    tried = [int(entry["n_trials"]) for entry in figures["data"] if entry["n_trials"] != ALL]
    return _plain(None if enough is None else max(tried, default=0) + 1 if enough == ALL else int(enough))


def _data_cell(figures: Figures) -> str:
    enough = figures["enough_trials"]
    return NONE if enough is None else "1 trial is enough" if enough == "1" else f"{enough} trials are enough"


def _data(ours: Figures) -> Iterator[str]:
    n, whole = ours["enough_trials"], ours["data"][-1]
    trials = "All training trials are" if n == ALL else f"{n} training trial{' is' if n == '1' else 's are'}"
    yield f"{trials} enough for `{OURS}` to be within 5 % of its error with all ({number(whole['rmse_3d_mm'])} mm)."


def _scalability_cell(figures: Figures) -> str:
    step, law = figures["step"], figures["exponents"]["step_size"]
    rate_hz = None if step is None else step["rate_both_hz"]
    both = "" if rate_hz is None else f"both hands up to {rate_text(rate_hz)}"
    return ", ".join(filter(None, (both, "" if law is None else f"step: size^{law['exponent']:z.2f}"))) or NONE


def _scalability(ours: Figures) -> Iterator[str]:
    train, step = ours["exponents"]["train_size"], ours["exponents"]["step_size"]
    yield f"The time of a step of `{OURS}` grows with the block rows to the power {exponent_text(step)}."
    if train is not None:
        yield f"The time of its training grows with them to the power {exponent_text(train)}."
    fast = ours["fast"]
    if fast is not None and fast["step_p99_us"] is not None:
        enough = "less" if fast["step_p99_us"] < TICK_US else "more"
        p99 = number(fast["step_p99_us"])
        yield f"At 1000 ticks a second a step takes {p99} µs at p99, {enough} than a tick lasts."


def _worst_noise(figures: Figures, measure: str) -> Figures | None:
    """Return the entry of the greatest noise, after training without noise or with it (``noise_trained``)."""
    return max(figures[measure], key=lambda entry: float(entry["noise_mm"]), default=None)


def _noise_cell(figures: Figures) -> str:
    entry, trained = _worst_noise(figures, "noise"), _worst_noise(figures, "noise_trained")
    also = "" if trained is None else f"; trained with it {trained['ratio_to_hold']:.3f}"
    return NONE if entry is None else _at_worst(entry, f"{entry['noise_mm']:g} mm") + also


def _noise(ours: Figures) -> Iterator[str]:
    for measure, training in (("noise", "did not have"), ("noise_trained", "had as well")):
        entry = _worst_noise(ours, measure)
        if entry is not None and entry["growth"] is not None:
            ratio = entry["growth"]["ratio"]
            beside = "worse than holding" if entry["ratio_to_hold"] > 1 else "better than holding"
            yield (
                f"With {entry['noise_mm']:g} mm of noise, which its training {training}, the error of `{OURS}` "
                f"{growth_words(ratio)} ({number(ratio)} times that without), which is {beside} the newest noisy "
                f"sample ({number(entry['ratio_to_hold'])} of hold's)."
            )


def _training_cell(figures: Figures) -> str:
    return NONE if figures["training_s"] is None else f"{number(figures['training_s'])} s"


def _training_time(ours: Figures) -> Iterator[str]:
    yield f"All training trials take `{OURS}` {number(ours['training_s'])} s of processor time."


def _reliability_cell(figures: Figures) -> str:
    found = figures["reliability"]
    if found is None:
        return NONE
    covered = "" if found["coverage_pct"] is None else f", {found['coverage_pct']:.1f} % in 95 % regions"
    return f"p99 {number(found['error_p99_mm'])} mm, {found['missing_pct']:.3g} % missing{covered}"


def _reliability(ours: Figures) -> Iterator[str]:
    found = ours["reliability"]
    covered = found["coverage_pct"]
    said = "" if covered is None else f"; {number(covered)} % of the errors lie in its 95 % regions"
    p95, p99, most = (number(found[f"error_{name}_mm"]) for name in ("p95", "p99", "p100"))
    yield (
        f"On a network that delays by 50 to 150 ms and loses 5 % in bursts the error of `{OURS}` is {p95} mm at p95, "
        f"{p99} at p99 and {most} at most; an estimate is missing at {found['missing_pct']:.3g} % of the "
        f"ticks{said}."
    )


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


def _applications_cell(figures: Figures) -> str:
    return " / ".join(f"{entry['ratio_to_hold']:.3f}" for entry in figures["accuracy"]) or NONE


def _applications(ours: Figures) -> Iterator[str]:
    each = ours["accuracy"]
    better = [entry for entry in each if (entry["high"] if entry["high"] is not None else entry["ratio_to_hold"]) < 1]
    delays = ", ".join(f"{number(entry['ratio_to_hold'])} at {entry['delay_ms']:g} ms" for entry in each)
    yield f"Beside hold `{OURS}` errs by {delays}; it is better at {len(better)} of {len(each)} delays."


def _said(kalman: str, transformers: str, gpr_drmf: str) -> dict[Family, str]:
    return {"kalman": kalman, "transformers": transformers, "gpr_drmf": gpr_drmf}


CLAIMS: Final[dict[str, Claim]] = {
    "complexity": Claim(
        "Computational Complexity",
        _said("Low (O(n))", "Moderate to High (O(n^2 d) to O(n^3))", "High (O(n^3))"),
        _complexity_cell,
        _exponent("train_rows"),
        "exponent of the training time against rows",
        _complexity,
        is_exponent=True,
    ),
    "real_time": Claim(
        "Real-Time Performance",
        _said("High", "Moderate", "Limited"),
        _real_time_cell,
        lambda figures: _plain(None if figures["step"] is None else figures["step"]["p99_us"]),
        "p99 of a step",
        _real_time,
        "µs",
    ),
    "packet_loss": Claim(
        "Handling Packet Loss",
        _said("Robust", "Moderate", "Sensitive"),
        _loss_cell,
        lambda figures: _ratio_of(_worst_loss(figures)),
        "error over hold's at the greatest loss",
        _packet_loss,
    ),
    "adaptability": Claim(
        "Adaptability",
        _said("High", "Low", "Limited"),
        _adaptability_cell,
        lambda figures: _ratio_of(_largest_growth(figures), "ratio"),
        "largest error after training on others over that on the own person",
        _adaptability,
    ),
    "data": Claim(
        "Data Requirements",
        _said("Moderate", "High", "High"),
        _data_cell,
        _enough,
        "training trials that are enough",
        _data,
    ),
    "scalability": Claim(
        "Scalability",
        _said("Excellent", "Moderate", "Challenging"),
        _scalability_cell,
        _exponent("step_size"),
        "exponent of a step's time against block rows",
        _scalability,
        is_exponent=True,
    ),
    "noise": Claim(
        "Robustness to Noise",
        _said("Excellent", "Moderate", "Limited"),
        _noise_cell,
        lambda figures: _ratio_of(_worst_noise(figures, "noise_trained")),
        "error over hold's at the greatest noise, trained with it",
        _noise,
    ),
    "training_time": Claim(
        "Training Time",
        _said("Minimal", "Significant", "Considerable"),
        _training_cell,
        lambda figures: _plain(figures["training_s"]),
        "training",
        _training_time,
        "s",
    ),
    "reliability": Claim(
        "Reliability",
        _said("High", "Moderate", "Moderate"),
        _reliability_cell,
        lambda figures: _plain(None if figures["reliability"] is None else figures["reliability"]["error_p99_mm"]),
        "p99 of the error",
        _reliability,
        "mm",
    ),
    "applications": Claim(
        "Real-World Applications",
        _said("Ideal for Tactile Internet", "Limited", "Theoretical Focus"),
        _applications_cell,
        _mean_ratio,
        "error over hold's, mean of the delays",
        _applications,
    ),
}
"""The rows. Oracle: figures written by hand, test_verdicts and test_page."""
