"""Findings on the paper's own method in each row of its table, in words chosen by rules from the figures."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from tis.deploy.methods.claims import OURS, Feature
from tis.deploy.methods.merits import largest_growth, worst_loss, worst_noise
from tis.deploy.methods.tables import exponent_text, rate_text
from tis.deploy.present.numbers import number

Figures = Mapping[str, Any]

TICK_US: Final = 1000.0
"""Time between ticks at 1 kHz."""
_GROWTHS: Final = ((1.1, "hardly grows"), (1.5, "grows somewhat"), (3.0, "grows much"), (float("inf"), "multiplies"))
"""Words of an error's growth, each up to a ratio."""


def growth_words(ratio: float) -> str:
    """Return the words for an error that has become ``ratio`` times as large."""
    return next(words for most, words in _GROWTHS if ratio <= most)


def _beside_linear(law: Mapping[str, Any]) -> str:
    """Return how an exponent stands to the paper's O(n)."""
    low, high = (law["exponent"] if law[bound] is None else law[bound] for bound in ("low", "high"))
    if low > 1.0:
        return "more than the paper's O(n)"
    return "no more than the paper's O(n)" if high <= 1.0 else "what the paper's O(n) says, within the interval"


def _complexity(ours: Figures) -> Iterator[str]:
    law, step = ours["exponents"]["train_rows"], ours["exponents"]["step_rows"]
    power = f"{exponent_text(law)}: {_beside_linear(law)}"
    yield f"The time to train `{OURS}` grows with the training rows to the power {power}."
    if step is not None:
        yield f"The time of a step grows with them to the power {exponent_text(step)}."


def _real_time(ours: Figures) -> Iterator[str]:
    step = ours["step"]
    rate = "" if step["rate_hz"] is None else f"; its steps keep up with ticks at {rate_text(step['rate_hz'])}"
    times = f"{number(step['p50_us'])} µs at the median, {number(step['p99_us'])} at p99"
    yield f"A step of `{OURS}` takes {times}{rate}."


def _packet_loss(ours: Figures) -> Iterator[str]:
    entry = worst_loss(ours)
    if entry is not None and entry["growth"] is not None:
        how = " in bursts" if entry["bursts"] else ""
        yield (
            f"With {entry['loss_pct']:g} % lost{how} the error of `{OURS}` {growth_words(entry['growth']['ratio'])} "
            f"({number(entry['growth']['ratio'])} times that without loss), and is {number(entry['ratio_to_hold'])} "
            f"of hold's, which suffers as well."
        )


def _adaptability(ours: Figures) -> Iterator[str]:
    entry = largest_growth(ours)
    if entry is not None:
        yield (
            f"Trained on others ({entry['trained_on']}) the error of `{OURS}` {growth_words(entry['ratio'])}: "
            f"{number(entry['ratio'])} times that after training on the same person."
        )


def _data(ours: Figures) -> Iterator[str]:
    n, whole = ours["enough_trials"], ours["data"][-1]
    trials = "All training trials are" if n == "all" else f"{n} training trial{' is' if n == '1' else 's are'}"
    yield f"{trials} enough for `{OURS}` to be within 5 % of its error with all ({number(whole['rmse_3d_mm'])} mm)."


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


def _noise(ours: Figures) -> Iterator[str]:
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


def _training_time(ours: Figures) -> Iterator[str]:
    yield f"All training trials take `{OURS}` {number(ours['training_s'])} s of processor time."


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


def _applications(ours: Figures) -> Iterator[str]:
    each = ours["accuracy"]
    better = [entry for entry in each if (entry["high"] if entry["high"] is not None else entry["ratio_to_hold"]) < 1]
    delays = ", ".join(f"{number(entry['ratio_to_hold'])} at {entry['delay_ms']:g} ms" for entry in each)
    yield f"Beside hold `{OURS}` errs by {delays}; it is better at {len(better)} of {len(each)} delays."


FINDINGS: Final[dict[Feature, Callable[[Figures], Iterator[str]]]] = {
    "complexity": _complexity,
    "real_time": _real_time,
    "packet_loss": _packet_loss,
    "adaptability": _adaptability,
    "data": _data,
    "scalability": _scalability,
    "noise": _noise,
    "training_time": _training_time,
    "reliability": _reliability,
    "applications": _applications,
}
