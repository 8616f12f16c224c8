"""The border of a touch: bisection against loops of known limits, and the command on a small grid."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
from rich.console import Console

from tis.common.errors import InputError
from tis.deploy.studies.touch.command import report_of, table_of, touch
from tis.deploy.studies.touch.plots import touch_figure
from tis.deploy.studies.touch.study import Loop, Run, Twin, find_borders, loops_of

HOLD, WAVE = Loop("position_force", "hold"), Loop("wave", "hold")
GIVEN = {
    "scenario": "touch", "settings": None, "seed": None, "duration_s": None, "estimators": "hold",
    "couplings": "position_force", "delays": "25", "walls": "30,3000", "steps": 1,
}  # fmt: skip


def _walls(true_n_m: float, rounds: list[int]) -> Run:
    """Loops of position and force that are stable below a stiffness over the delay; waves always are."""

    def run(asked: Sequence[tuple[Loop, float, float]]) -> list[Twin]:
        rounds.append(len(asked))
        return [
            Twin(loop, ms, wall, loop == WAVE or wall < true_n_m / ms, true_n_m / ms, 0.0, 1.0)
            for loop, ms, wall in asked
        ]

    return run


def test_each_border_encloses_the_limit_and_a_passive_loop_takes_one_twin() -> None:
    rounds: list[int] = []
    borders, twins = find_borders([HOLD, WAVE], [10.0, 20.0], (30.0, 3000.0), 5, _walls(5000.0, rounds))
    assert rounds == [4, 2, 2, 2, 2, 2, 2]
    assert len(twins) == 16
    of_hold = [one for one in borders if one.loop == HOLD]
    for one in of_hold:
        assert one.stable_n_m is not None
        assert one.not_stable_n_m is not None
        assert one.stable_n_m < 5000.0 / one.delay_ms <= one.not_stable_n_m
        assert one.not_stable_n_m / one.stable_n_m == pytest.approx(100 ** (1 / 32))
    assert all(one.stable_n_m == 3000.0 and one.not_stable_n_m is None for one in borders if one.loop == WAVE)
    report = report_of(borders, twins, (30.0, 3000.0))
    rows = list(table_of(borders).texts())
    assert [row[0] for row in rows] == ["10", "20"]
    assert [row[2] for row in rows] == ["> 3000", "> 3000"]
    (axes,) = touch_figure(report).axes
    assert [line.get_label() for line in axes.get_lines()][-1] == "theory, newest sample"


def test_a_loop_that_not_even_the_softest_wall_leaves_stable_has_none() -> None:
    borders, twins = find_borders([HOLD], [10.0], (30.0, 3000.0), 5, _walls(100.0, []))
    assert borders[0].stable_n_m is None
    assert len(twins) == 2
    assert next(table_of(borders).texts())[1] == "none"


def test_only_position_force_has_a_loop_for_each_estimator() -> None:
    assert [one.name for one in loops_of(["position_force", "wave"], ["hold", "moesp_kf"])] == [
        "position_force, hold", "position_force, moesp_kf", "wave",
    ]  # fmt: skip


def test_the_command_writes_what_its_twins_told(tmp_path: Path) -> None:
    settings = ["rate_hz=250", "identification.train_samples=1000", "drain_s=0.2"]
    quiet = Console(quiet=True)
    assert touch({**GIVEN, "settings": settings, "duration_s": 3.0, "walls": "30,1500", "steps": 0}, tmp_path / "out",
                 False, 1, quiet, quiet) == 0  # fmt: skip
    report = json.loads((tmp_path / "out" / "touch.json").read_text())
    assert [(twin["stiffness_n_m"], twin["stable"]) for twin in report["twins"]] == [(1500.0, False), (30.0, True)]
    assert 150 < report["borders"][0]["limit_n_m"] < 260
    assert (tmp_path / "out" / "touch.svg").is_file()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"delays": "five"}, "--delays"),
        ({"walls": "3000,30,2"}, "--walls"),
        ({"couplings": "springs"}, "springs"),
        ({"scenario": "default"}, "must touch a wall"),
        ({"settings": ["touch.environment={kind: tissue}"]}, "must touch a wall"),
    ],
)
def test_what_cannot_be_searched_is_refused_in_words(tmp_path: Path, changed: dict[str, object], words: str) -> None:
    quiet = Console(quiet=True)
    with pytest.raises(InputError, match=words):
        touch({**GIVEN, **changed}, tmp_path / "out", False, 1, quiet, quiet)
