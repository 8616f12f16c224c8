"""Rows of the paper's table: the measured cell of a method, its merit, and findings on the paper's own method."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final, NamedTuple

from tis.deploy.present.numbers import NONE, number
from tis.deploy.studies.methods.plans import ALL

Figures = Mapping[str, Any]

HZ_PER_KHZ: Final = 1000.0


class Merit(NamedTuple):
    """A figure of which less is better; ``low`` and ``high`` are its 95 % interval, None where it has none."""

    value: float
    low: float | None = None
    high: float | None = None


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


def is_useful(figures: Figures) -> bool:
    """Tell whether a method errs less than hold, on average over the delays: otherwise no other merit counts."""
    ratio = mean_ratio(figures)
    return ratio is None or ratio.value < 1.0


def plain(value: float | None) -> Merit | None:
    """Return a merit without an interval."""
    return None if value is None else Merit(float(value))


def exponent_of(name: str) -> Callable[[Figures], Merit | None]:
    """Return the merit that is an exponent."""

    def merit(figures: Figures) -> Merit | None:
        law = figures["exponents"][name]
        return None if law is None else Merit(law["exponent"], law["low"], law["high"])

    return merit


def ratio_of(entry: Figures | None, name: str = "ratio_to_hold") -> Merit | None:
    """Return the merit that is a ratio of an entry."""
    return None if entry is None else Merit(entry[name], entry["low"], entry["high"])


def _at_worst(entry: Figures | None, what: str) -> str:
    if entry is None:
        return NONE
    growth = "" if entry["growth"] is None else f"error ×{entry['growth']['ratio']:.2f}, "
    return f"{what}: {growth}{entry['ratio_to_hold']:.3f} of hold's"


def complexity_cell(figures: Figures) -> str:
    """Return the exponents of training and step."""
    laws = figures["exponents"]
    words = {"train_rows": "training: rows", "train_size": "size", "step_rows": "step: rows", "step_size": "size"}
    return ", ".join(f"{words[name]}^{laws[name]['exponent']:z.2f}" for name in words if laws[name]) or NONE


def real_time_cell(figures: Figures) -> str:
    """Return the times of a step and the highest rate."""
    step = figures["step"]
    if step is None:
        return NONE
    rate = "" if step["rate_hz"] is None else f"; up to {rate_text(step['rate_hz'])}"
    return f"{number(step['p50_us'])} µs, p99 {number(step['p99_us'])}{rate}"


def worst_loss(figures: Figures) -> Figures | None:
    """Return the entry of the greatest loss, in bursts rather than independent."""
    return max(figures["loss"], key=lambda entry: (entry["loss_pct"], entry["bursts"]), default=None)


def loss_cell(figures: Figures) -> str:
    """Return what the greatest loss does to the error."""
    entry = worst_loss(figures)
    return _at_worst(entry, "" if entry is None else loss_head(entry))


def largest_growth(figures: Figures) -> Figures | None:
    """Return the entry of the training on others after which the error is largest."""
    return max(figures["adaptability"], key=lambda entry: float(entry["ratio"]), default=None)


def adaptability_cell(figures: Figures) -> str:
    """Return the largest growth of the error after training on others."""
    entry = largest_growth(figures)
    return NONE if entry is None else f"error ×{entry['ratio']:.2f} ({entry['trained_on']})"


def enough_trials(figures: Figures) -> Merit | None:
    """Return the number of trials that are enough; with all of them, one more than the largest number tried."""
    enough = figures["enough_trials"]
    tried = [int(entry["n_trials"]) for entry in figures["data"] if entry["n_trials"] != ALL]
    return plain(None if enough is None else max(tried, default=0) + 1 if enough == ALL else int(enough))


def data_cell(figures: Figures) -> str:
    """Return the number of training trials that are enough."""
    enough = figures["enough_trials"]
    return NONE if enough is None else "1 trial is enough" if enough == "1" else f"{enough} trials are enough"


def scalability_cell(figures: Figures) -> str:
    """Return the rate that both hands allow, and the exponent of a step."""
    step, law = figures["step"], figures["exponents"]["step_size"]
    rate_hz = None if step is None else step["rate_both_hz"]
    both = "" if rate_hz is None else f"both hands up to {rate_text(rate_hz)}"
    return ", ".join(filter(None, (both, "" if law is None else f"step: size^{law['exponent']:z.2f}"))) or NONE


def worst_noise(figures: Figures, measure: str) -> Figures | None:
    """Return the entry of the greatest noise, after training without noise or with it (``noise_trained``)."""
    return max(figures[measure], key=lambda entry: float(entry["noise_mm"]), default=None)


def noise_cell(figures: Figures) -> str:
    """Return what the greatest noise does to the error, after either training."""
    entry, trained = worst_noise(figures, "noise"), worst_noise(figures, "noise_trained")
    also = "" if trained is None else f"; trained with it {trained['ratio_to_hold']:.3f}"
    return NONE if entry is None else _at_worst(entry, f"{entry['noise_mm']:g} mm") + also


def training_cell(figures: Figures) -> str:
    """Return the time of training."""
    return NONE if figures["training_s"] is None else f"{number(figures['training_s'])} s"


def reliability_cell(figures: Figures) -> str:
    """Return error, missing estimates and coverage on a network that delays and loses."""
    found = figures["reliability"]
    if found is None:
        return NONE
    covered = "" if found["coverage_pct"] is None else f", {found['coverage_pct']:.1f} % in 95 % regions"
    return f"p99 {number(found['error_p99_mm'])} mm, {found['missing_pct']:.3g} % missing{covered}"


def mean_ratio(figures: Figures) -> Merit | None:
    """Return the mean of the ratios to hold over the delays, and that of the bounds of their intervals."""
    each = figures["accuracy"]
    if not each:
        return None
    bounds = [
        None if any(entry[name] is None for entry in each) else sum(entry[name] for entry in each) / len(each)
        for name in ("low", "high")
    ]
    return Merit(sum(entry["ratio_to_hold"] for entry in each) / len(each), *bounds)


def applications_cell(figures: Figures) -> str:
    """Return the ratios to hold by delay."""
    return " / ".join(f"{entry['ratio_to_hold']:.3f}" for entry in figures["accuracy"]) or NONE


# Findings on the paper's own method in each row of its table: sentences chosen by rules from the figures.


OURS: Final = "moesp_kf"
"""The paper's method as the testbed builds it; `paper` is its Algorithm 1."""
TICK_US: Final = 1000.0
"""Time between ticks at 1 kHz."""
_GROWTHS: Final = ((1.1, "hardly grows"), (1.5, "grows somewhat"), (3.0, "grows much"), (float("inf"), "multiplies"))
"""Words of an error's growth, each up to a ratio."""


def growth_words(ratio: float) -> str:
    """Return the words for an error that has become ``ratio`` times as large."""
    return next(words for most, words in _GROWTHS if ratio <= most)


def complexity(ours: Figures) -> Iterator[str]:
    """Yield how training and step grow with the training rows."""
    law, step = ours["exponents"]["train_rows"], ours["exponents"]["step_rows"]
    low, high = (law["exponent"] if law[bound] is None else law[bound] for bound in ("low", "high"))
    beside = "what the paper's O(n) says, within the interval"
    beside = "more than the paper's O(n)" if low > 1.0 else "no more than the paper's O(n)" if high <= 1.0 else beside
    yield f"The time to train `{OURS}` grows with the training rows to the power {exponent_text(law)}: {beside}."
    if step is not None:
        yield f"The time of a step grows with them to the power {exponent_text(step)}."


def real_time(ours: Figures) -> Iterator[str]:
    """Yield how long a step takes."""
    step = ours["step"]
    rate = "" if step["rate_hz"] is None else f"; its steps keep up with ticks at {rate_text(step['rate_hz'])}"
    times = f"{number(step['p50_us'])} µs at the median, {number(step['p99_us'])} at p99"
    yield f"A step of `{OURS}` takes {times}{rate}."


def packet_loss(ours: Figures) -> Iterator[str]:
    """Yield what the greatest loss does."""
    entry = worst_loss(ours)
    if entry is not None and entry["growth"] is not None:
        how = " in bursts" if entry["bursts"] else ""
        yield (
            f"With {entry['loss_pct']:g} % lost{how} the error of `{OURS}` {growth_words(entry['growth']['ratio'])} "
            f"({number(entry['growth']['ratio'])} times that without loss), and is {number(entry['ratio_to_hold'])} "
            f"of hold's, which suffers as well."
        )


def adaptability(ours: Figures) -> Iterator[str]:
    """Yield what training on others does."""
    entry = largest_growth(ours)
    if entry is not None:
        yield (
            f"Trained on others ({entry['trained_on']}) the error of `{OURS}` {growth_words(entry['ratio'])}: "
            f"{number(entry['ratio'])} times that after training on the same person."
        )


def data(ours: Figures) -> Iterator[str]:
    """Yield how many training trials are enough."""
    n, whole = ours["enough_trials"], ours["data"][-1]
    trials = "All training trials are" if n == ALL else f"{n} training trial{' is' if n == '1' else 's are'}"
    yield f"{trials} enough for `{OURS}` to be within 5 % of its error with all ({number(whole['rmse_3d_mm'])} mm)."


def scalability(ours: Figures) -> Iterator[str]:
    """Yield how training and step grow with the block rows, and the step at 1 kHz."""
    train, step = ours["exponents"]["train_size"], ours["exponents"]["step_size"]
    yield f"The time of a step of `{OURS}` grows with the block rows to the power {exponent_text(step)}."
    if train is not None:
        yield f"The time of its training grows with them to the power {exponent_text(train)}."
    fast = ours["fast"]
    if fast is not None and fast["step_p99_us"] is not None:
        enough = "less" if fast["step_p99_us"] < TICK_US else "more"
        p99 = number(fast["step_p99_us"])
        yield f"At 1000 ticks a second a step takes {p99} µs at p99, {enough} than a tick lasts."


def noise(ours: Figures) -> Iterator[str]:
    """Yield what the greatest noise does, after either training."""
    for measure, training in (("noise", "did not have"), ("noise_trained", "had as well")):
        entry = worst_noise(ours, measure)
        if entry is not None and entry["growth"] is not None:
            ratio = entry["growth"]["ratio"]
            beside = "worse than holding" if entry["ratio_to_hold"] > 1 else "better than holding"
            yield (
                f"With {entry['noise_mm']:g} mm of noise, which its training {training}, the error of `{OURS}` "
                f"{growth_words(ratio)} ({number(ratio)} times that without), which is {beside} the newest noisy "
                f"sample ({number(entry['ratio_to_hold'])} of hold's)."
            )


def training_time(ours: Figures) -> Iterator[str]:
    """Yield how long training takes."""
    yield f"All training trials take `{OURS}` {number(ours['training_s'])} s of processor time."


def reliability(ours: Figures) -> Iterator[str]:
    """Yield the errors on a network that delays and loses."""
    found = ours["reliability"]
    covered = found["coverage_pct"]
    said = "" if covered is None else f"; {number(covered)} % of the errors lie in its 95 % regions"
    p95, p99, most = (number(found[f"error_{name}_mm"]) for name in ("p95", "p99", "p100"))
    yield (
        f"On a network that delays by 50 to 150 ms and loses 5 % in bursts the error of `{OURS}` is {p95} mm at p95, "
        f"{p99} at p99 and {most} at most; an estimate is missing at {found['missing_pct']:.3g} % of the "
        f"ticks{said}."
    )


def applications(ours: Figures) -> Iterator[str]:
    """Yield the errors beside hold's by delay."""
    each = ours["accuracy"]
    better = [entry for entry in each if (entry["high"] if entry["high"] is not None else entry["ratio_to_hold"]) < 1]
    delays = ", ".join(f"{number(entry['ratio_to_hold'])} at {entry['delay_ms']:g} ms" for entry in each)
    yield f"Beside hold `{OURS}` errs by {delays}; it is better at {len(better)} of {len(each)} delays."
