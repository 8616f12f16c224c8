"""Stability of a ranking: the same estimators under other seeds, each of other people and other arrivals."""

import json
from collections.abc import Mapping, Sequence
from itertools import combinations, pairwise
from typing import Any, NamedTuple

from scipy.stats import kendalltau

from tis.deploy.compare.cells.identity import software_digest
from tis.deploy.present.table import Column, Table

Scores = Mapping[str, Sequence[float]]
"""The score of each estimator under each seed, in the order of the first: the protocol's, and so the printed one."""


class Pair(NamedTuple):
    """Two estimators in the printed order, how often they change places, and the first's error over the other's."""

    better: str
    worse: str
    n_changed: int
    ratios: tuple[float, ...]


def stability_of(rows: Sequence[Sequence[Mapping[str, Any]]]) -> dict[str, Any]:
    """Return the scores of each estimator by seed, from the rows of each seed; the first seed is the protocol's."""
    first = sorted(rows[0], key=lambda row: (row["score"], row["estimator"]))
    by_seed = [{row["estimator"]: row["score"] for row in each} for each in rows]
    about = {name: first[0][name] for name in ("protocol", "protocol_sha256", "track", "quick", "n_people")}
    names = [row["estimator"] for row in first]
    return {
        **about,
        "seeds": [each[0]["seed"] for each in rows],
        "software": software_digest(),
        "scores": {name: [scores[name] for scores in by_seed] for name in names},
    }


def as_text(found: Mapping[str, Any]) -> str:
    """Return the text of the file: a line for each estimator's scores, so that differences can be read."""
    lines = ",\n".join(f"  {json.dumps(name)}: {json.dumps(own)}" for name, own in found["scores"].items())
    about = "".join(f" {json.dumps(name)}: {json.dumps(found[name])},\n" for name in found if name != "scores")
    return f'{{\n{about} "scores": {{\n{lines}\n }}\n}}\n'


def pairs(scores: Scores) -> list[Pair]:
    """Return all pairs in the printed order; equal scores change no places."""
    found = []
    for better, worse in combinations(scores, 2):
        both = list(zip(scores[better], scores[worse], strict=True))
        found.append(Pair(better, worse, sum(one > other for one, other in both), tuple(a / b for a, b in both)))
    return found


def taus(scores: Scores) -> list[float]:
    """Return Kendall's tau-b of each further seed's order with the printed one."""
    by_seed = list(zip(*scores.values(), strict=True))
    return [float(kendalltau(by_seed[0], each).statistic) for each in by_seed[1:]]


def words(found: Mapping[str, Any]) -> str:
    """Return how often the printed order is kept."""
    scores, seeds = found["scores"], found["seeds"]
    correlations = taus(scores)
    n_kept = sum(all(a <= b for a, b in pairwise(each)) for each in zip(*scores.values(), strict=True))
    quick = ", of the quick sample" if found["quick"] else ""
    mean = sum(correlations) / len(correlations)
    return (
        f"{n_kept} of {len(seeds)} seeds ({seeds[0]} to {seeds[-1]}{quick}) have the order of seed {seeds[0]}; "
        f"Kendall's tau with it is {mean:.2f} on average, {min(correlations):.2f} at least"
    )


def tables(found: Mapping[str, Any]) -> list[Table]:
    """Return the scores over all seeds, and the pairs."""
    scores: Scores = found["scores"]
    heads = ("estimator", f"seed {found['seeds'][0]}", "mean", "least", "most")
    rows = [
        [name, *(f"{value:.3f}" for value in (own[0], sum(own) / len(own), min(own), max(own)))]
        for name, own in scores.items()
    ]
    columns = ("better", Column("worse", words=True), "seeds that change", "ratio", "least", "most")
    lines = [
        [pair.better, pair.worse, f"{pair.n_changed} of {len(pair.ratios)}"]
        + [f"{value:.2f}" for value in (sum(pair.ratios) / len(pair.ratios), min(pair.ratios), max(pair.ratios))]
        for pair in pairs(scores)
    ]
    return [Table("", heads, rows), Table("", columns, lines)]
