"""Verdicts on the adjectives of the paper: sentences chosen by rules from the figures.

A method is better than another in a row of the table if its merit is smaller by more than `CLEARLY` (of the larger
one; of exponents, which may be 0, in absolute terms) and their intervals, where both have one, do not overlap.
Everything else cannot be told apart. The best of all is sought among the methods that err less than hold.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, Literal

from tis.deploy.present.numbers import number
from tis.deploy.studies.methods.claims import CLAIMS, FAMILY_TITLES, MEMBERS, Claim
from tis.deploy.studies.methods.findings import OURS
from tis.deploy.studies.methods.measured import Figures, Merit, is_useful
from tis.deploy.studies.methods.plans import HOLD

Order = Literal["better", "worse", "not told apart"]

CLEARLY: Final = 0.05
"""Relative difference of merits from which one method is better."""
_WORDS: Final[dict[Order, str]] = {
    "better": "so the paper's order holds",
    "worse": "so the paper's order does not hold",
    "not told apart": "which cannot be told apart",
}


def order_of(one: Merit, other: Merit, is_exponent: bool = False) -> Order:
    """Return whether one merit is better than another, by the rule of this module. Oracle: test_verdicts."""
    size = 1.0 if is_exponent else max(abs(one.value), abs(other.value))
    if abs(one.value - other.value) <= CLEARLY * size:
        return "not told apart"
    first, second = (one, other) if one.value < other.value else (other, one)
    if first.high is not None and second.low is not None and first.high >= second.low:
        return "not told apart"
    return "better" if first is one else "worse"


def verdicts(methods: Sequence[Figures]) -> dict[str, str]:
    """Return the sentences on each row of the paper's table, by its title."""
    return {claim.title: verdict_of(claim, methods) for claim in CLAIMS.values()}


def verdict_of(claim: Claim, methods: Sequence[Figures]) -> str:
    """Return the sentences on one row of the table."""
    by_name = {str(figures["method"]): figures for figures in methods}
    merits = {name: merit for name, figures in by_name.items() if (merit := claim.merit(figures)) is not None}
    own = claim.found(by_name[OURS]) if OURS in merits else iter([f"Of `{OURS}` this was not measured."])
    rivals = {name: merit for name, merit in merits.items() if name != HOLD and is_useful(by_name[name])}
    sentences = [*own, *_beside(claim, merits), *_best(claim, rivals)]
    return f"The paper: *{claim.words['kalman']}*. {' '.join(sentences)}"


def _beside(claim: Claim, merits: Mapping[str, Merit]) -> Iterator[str]:
    """Yield how the paper's method stands to the best one of each other family."""
    ours = merits.get(OURS)
    for family, title in FAMILY_TITLES.items():
        if family == "kalman":
            continue
        said = f"{title} (the paper: {claim.words[family]})"
        found = {name: merits[name] for name in MEMBERS[family] if name in merits}
        if not found:
            yield f"{said}: not measured."
        elif ours is not None:
            best = min(found, key=lambda name: found[name].value)
            order = order_of(ours, found[best], claim.is_exponent)
            yield f"{said}: `{best}` has {_with_unit(found[best], claim)}, {_WORDS[order]}."


def _best(claim: Claim, found: Mapping[str, Merit]) -> Iterator[str]:
    """Yield which of all methods is best."""
    if len(found) < 2:
        return
    best = min(found, key=lambda name: found[name].value)
    equal = [
        f"`{name}`"
        for name in found
        if name != best and order_of(found[best], found[name], claim.is_exponent) == "not told apart"
    ]
    beside = f"; not told apart from it: {', '.join(equal)}" if equal else ""
    yield f"The smallest of all ({claim.meaning}) is that of `{best}`, {_with_unit(found[best], claim)}{beside}."


def _with_unit(merit: Merit, claim: Claim) -> str:
    return f"{number(merit.value)} {claim.unit}".strip()
