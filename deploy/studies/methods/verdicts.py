"""Verdicts on the adjectives of the paper: sentences chosen by rules from the figures.

A method is better than another in a row of the table if its merit is smaller by more than `CLEARLY` (of the larger
one; of exponents, which may be 0, in absolute terms) and their intervals, where both have one, do not overlap.
Everything else cannot be told apart. The best of all is sought among the methods that err less than hold.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final, Literal

from tis.deploy.present.numbers import number
from tis.deploy.studies.methods.claims import (
    CLAIMS,
    FAMILY_TITLES,
    MEMBERS,
    OURS,
    Family,
    Feature,
    Merit,
    is_useful,
    largest_growth,
    merit_of,
    merit_words,
    worst_loss,
    worst_noise,
)
from tis.deploy.studies.methods.plans import HOLD
from tis.deploy.studies.methods.tables import exponent_text, rate_text

# Findings on the paper's own method in each row of its table, in words chosen by rules from the figures.

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


Order = Literal["better", "worse", "not told apart"]

EXPONENTS: Final[tuple[Feature, ...]] = ("complexity", "scalability")
"""Rows whose merit is an exponent."""
CLEARLY: Final = 0.05
"""Relative difference of merits from which one method is better."""
_OTHERS: Final[tuple[Family, ...]] = ("transformers", "gpr_drmf")


def order_of(one: Merit, other: Merit, is_exponent: bool = False) -> Order:
    """Return whether one merit is better than another, by the rule of this module. Oracle: test_verdicts."""
    size = 1.0 if is_exponent else max(abs(one.value), abs(other.value))
    if abs(one.value - other.value) <= CLEARLY * size:
        return "not told apart"
    first, second = (one, other) if one.value < other.value else (other, one)
    if first.high is not None and second.low is not None and first.high >= second.low:
        return "not told apart"
    return "better" if first is one else "worse"


def verdict_of(feature: Feature, methods: Sequence[Figures]) -> str:
    """Return the sentences on one row of the table."""
    by_name = {figures["method"]: figures for figures in methods}
    sentences = [*_own(feature, by_name), *_beside(feature, by_name), *_best(feature, methods)]
    return f"The paper: *{CLAIMS[feature].words['kalman']}*. {' '.join(sentences)}"


def _own(feature: Feature, by_name: Mapping[str, Figures]) -> Iterator[str]:
    """Yield what was found of the paper's own method."""
    ours = by_name.get(OURS)
    if ours is None or merit_of(feature, ours) is None:
        yield f"Of `{OURS}` this was not measured."
        return
    yield from FINDINGS[feature](ours)


def _beside(feature: Feature, by_name: Mapping[str, Figures]) -> Iterator[str]:
    """Yield how the paper's method stands to the best one of each other family."""
    ours = merit_of(feature, by_name[OURS]) if OURS in by_name else None
    for family in _OTHERS:
        found = {
            name: merit
            for name in MEMBERS[family]
            if name in by_name and (merit := merit_of(feature, by_name[name])) is not None
        }
        title = f"{FAMILY_TITLES[family]} (the paper: {CLAIMS[feature].words[family]})"
        if not found:
            yield f"{title}: not measured."
        elif ours is not None:
            best = min(found, key=lambda name: found[name].value)
            order = order_of(ours, found[best], feature in EXPONENTS)
            yield f"{title}: {_comparison(order, best, found[best], feature)}"


def _comparison(order: Order, name: str, merit: Merit, feature: Feature) -> str:
    value = _with_unit(merit.value, feature)
    if order == "better":
        return f"`{name}` has {value}, so the paper's order holds."
    if order == "worse":
        return f"`{name}` has {value}, so the paper's order does not hold."
    return f"`{name}` has {value}, which cannot be told apart."


def _best(feature: Feature, methods: Sequence[Figures]) -> Iterator[str]:
    """Yield which of all methods is best."""
    found = {
        str(figures["method"]): merit
        for figures in methods
        if figures["method"] != HOLD and is_useful(figures) and (merit := merit_of(feature, figures)) is not None
    }
    if len(found) < 2:
        return
    best = min(found, key=lambda name: found[name].value)
    words, _ = merit_words(feature)
    equal = [
        name
        for name in found
        if name != best and order_of(found[best], found[name], feature in EXPONENTS) == "not told apart"
    ]
    beside = f"; not told apart from it: {', '.join(f'`{name}`' for name in equal)}" if equal else ""
    yield f"The smallest of all ({words}) is that of `{best}`, {_with_unit(found[best].value, feature)}{beside}."


def _with_unit(value: float, feature: Feature) -> str:
    unit = merit_words(feature)[1]
    return f"{number(value)} {unit}".strip()


def verdicts(methods: Sequence[Figures]) -> dict[str, str]:
    """Return the sentences on each row of the paper's table, by its title."""
    return {claim.title: verdict_of(feature, methods) for feature, claim in CLAIMS.items()}
