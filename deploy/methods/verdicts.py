"""Verdicts on the adjectives of the paper: sentences chosen by rules from the figures.

A method is better than another in a row of the table if its merit is smaller by more than `CLEARLY` (of the larger
one; of exponents, which may be 0, in absolute terms) and their intervals, where both have one, do not overlap.
Everything else cannot be told apart. The best of all is sought among the methods that err less than hold.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, Literal

from tis.deploy.methods.claims import CLAIMS, FAMILY_TITLES, MEMBERS, OURS, Family, Feature
from tis.deploy.methods.findings import FINDINGS
from tis.deploy.methods.measures.plans import HOLD
from tis.deploy.methods.merits import Merit, is_useful, merit_of, merit_words
from tis.deploy.present.numbers import number

Figures = Mapping[str, Any]
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
