"""Findings on the paper's own method in each row of its table: sentences chosen by rules from the figures."""

from collections.abc import Iterator
from typing import Final

from tis.deploy.present.numbers import number
from tis.deploy.studies.methods.measured import (
    Figures,
    exponent_text,
    largest_growth,
    rate_text,
    worst_loss,
    worst_noise,
)
from tis.deploy.studies.methods.plans import ALL

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
