"""The ranking's stability: pairs that change places, and Kendall's tau with the printed order."""

import json

import pytest

from tis.deploy.studies.score.stability import as_text, pairs, stability_of, taus, words

SEEDS = (1, 2, 3)
SCORES = {"good": [0.3, 0.3, 0.5], "fair": [0.4, 0.4, 0.4], "hold": [1.0, 1.0, 1.0]}
"""good and fair change places under the third seed."""


def _rows() -> list[list[dict[str, object]]]:
    about = {"protocol": "v1", "protocol_sha256": "00", "track": "open", "quick": False, "n_people": 12}
    return [
        [about | {"estimator": name, "seed": seed, "score": SCORES[name][k]} for name in ("hold", "fair", "good")]
        for k, seed in enumerate(SEEDS)
    ]


def test_scores_stand_in_the_order_of_the_first_seed_and_their_file_is_json() -> None:
    found = stability_of(_rows())
    assert (found["seeds"], found["scores"], list(found["scores"])) == ([1, 2, 3], SCORES, list(SCORES))
    assert json.loads(as_text(found)) == found


def test_a_pair_changes_places_where_the_better_one_is_worse() -> None:
    assert [(pair.better, pair.worse, pair.n_changed) for pair in pairs(SCORES)] == [
        ("good", "fair", 1),
        ("good", "hold", 0),
        ("fair", "hold", 0),
    ]
    assert pairs(SCORES)[0].ratios == pytest.approx((0.75, 0.75, 1.25))
    assert [pair.n_changed for pair in pairs({"one": [0.3, 0.4], "other": [0.4, 0.4]})] == [0]


def test_tau_counts_pairs_in_the_other_order() -> None:
    """One pair of three is discordant: (2 - 1) / 3."""
    assert taus(SCORES) == pytest.approx([1.0, 1 / 3])
    assert "2 of 3 seeds (1 to 3)" in words(stability_of(_rows()))
