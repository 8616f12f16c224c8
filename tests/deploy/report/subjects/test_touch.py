"""Figures of touch by hand: stability of swings of known growth, energy, displayed stiffness, and theory's limit."""

from math import inf, pi

import numpy as np
import pytest
from numpy.typing import NDArray

from tis.common.coupling.stability import Arm, Limb, loop_limit
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_S
from tis.deploy.logs.read.frame import Frame
from tis.deploy.report.subjects.touch import Stability, TouchFigures, energy_j, judged, predicted_limit, stability
from tis.deploy.report.subjects.touch_tables import answer_text, stability_text, touch_tables, touch_text
from tis.deploy.run.resolve import resolve

RATE_HZ = 200
Array = NDArray[np.float64]


def _shown(off_m: Array, force_n: Array, intended_m: Array | None = None, limited: str = "") -> Frame:
    """Forces and places along z; the intention rests unless it is given."""
    n = len(off_m)
    intended = np.zeros(n) if intended_m is None else intended_m

    def along_z(values: Array) -> Array:
        return np.column_stack([np.zeros(n), np.zeros(n), values])

    return Frame.of_arrays(
        tick=np.arange(n),
        sample_ns=np.arange(n) * (NS_PER_S // RATE_HZ),
        position_m=along_z(intended + off_m),
        intended_m=along_z(intended),
        force_n=along_z(force_n),
        limited=np.full(n, limited),
    )


def _swing(growth_per_s: float, seconds: float = 6.0) -> Array:
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    return np.asarray(1e-3 * np.exp(growth_per_s * t) * np.sin(2 * pi * 4 * t))


@pytest.mark.parametrize(("growth_per_s", "found"), [(0.8, "unstable"), (-0.8, "stable")])
def test_a_swing_that_grows_is_unstable_and_one_that_decays_is_not(growth_per_s: float, found: Stability) -> None:
    off = _swing(growth_per_s)
    assert stability(_shown(off, np.full(len(off), 1.0)), RATE_HZ) == found


def test_where_the_network_was_changed_the_worst_stretch_decides() -> None:
    parts = [_swing(-0.8), _swing(0.8), _swing(-0.8)]
    off, n = np.concatenate(parts), len(parts[0])
    shown = _shown(off, np.full(len(off), 1.0))
    found, stretch = judged(shown, [n * NS_PER_S // RATE_HZ, 2 * n * NS_PER_S // RATE_HZ], RATE_HZ)
    assert (found, stretch.tick[0], len(stretch)) == ("unstable", n, n)
    found, stretch = judged(shown.at(slice(n)), [], RATE_HZ)
    assert (found, len(stretch)) == ("stable", n)


def test_a_force_that_its_limit_cuts_for_long_is_instability() -> None:
    off = _swing(0.0)
    assert stability(_shown(off, np.full(len(off), 20.0), limited="force"), RATE_HZ) == "unstable"


def test_without_contact_or_with_little_of_it_nothing_is_decided() -> None:
    off = _swing(0.0)
    assert stability(_shown(off, np.zeros(len(off))), RATE_HZ) == "not_decidable"
    short = np.zeros(len(off))
    short[:100] = 1.0
    assert stability(_shown(off, short), RATE_HZ) == "not_decidable"


def test_of_a_device_that_tells_no_intention_nothing_is_decided() -> None:
    moves = _swing(0.8)
    assert stability(_shown(np.zeros(len(moves)), np.full(len(moves), 1.0), moves), RATE_HZ) == "not_decidable"


def test_a_hand_that_moves_as_fast_as_it_intends_is_stable() -> None:
    t = np.arange(6 * RATE_HZ) / RATE_HZ
    moves = 0.01 * np.sin(2 * pi * t)
    assert stability(_shown(0.2 * moves, np.abs(moves) * 100, moves), RATE_HZ) == "stable"


def test_energy_is_the_hands_force_times_its_movement() -> None:
    """Against a force of 2 N the hand goes in by 10 mm, and is pushed out by 5 mm under 6 N."""
    place = np.array([0.0, -0.005, -0.010, -0.005])
    shown = _shown(place, np.array([2.0, 2.0, 6.0, 6.0]))
    assert energy_j(shown) == pytest.approx([0.0, 0.010, 0.020, -0.010])


def test_theory_is_asked_where_it_holds() -> None:
    scenario = resolve("touch", (), None, None)
    limb, arm = Limb(0.9, 6.0, 568.0), Arm(10.0, 1.0, 0.3)
    assert predicted_limit(scenario, 0.012) == pytest.approx(loop_limit(limb, arm, 0.012, 1e-3)) != inf

    def without(*settings: str) -> Scenario:
        return resolve("touch", settings, None, None)

    assert predicted_limit(without("touch.coupling=wave"), 0.012) is None
    assert predicted_limit(without("patient.plant={kind: mujoco}"), 0.012) is None


def test_theory_knows_the_simulated_hand_of_a_pointer_and_no_persons() -> None:
    assert predicted_limit(resolve("drive_touch", (), None, None), 0.12) is not None
    assert predicted_limit(resolve("drive_touch", ("touch.live_hand=own",), None, None), 0.12) is None


def _figures(**changed: object) -> TouchFigures:
    spread = {"rms": 0.1, "p50": 0.1, "p95": 0.2, "max": 0.3}
    values: dict[str, object] = {
        "stability": "stable", "stable": True, "stiffness_n_m": 120.0, "limit_n_m": 257.0, "shown_over_true": 0.91,
        "energy_mj": 1.2, "force_error_n": spread, "force_beyond_n": spread, "force_delay_ms": spread,
        "round_trip_ms": spread, "drift_mm": None, "peak_force_n": 4.1,
        "force_packets": {"sent": 10, "suppressed": 5}, "motion_packets": {"sent": 15, "suppressed": 0},
    }  # fmt: skip
    return TouchFigures.model_validate(values | changed)


def test_the_words_begin_with_stability_and_put_theorys_limit_beside_it() -> None:
    stable, unstable = _figures(), _figures(stability="unstable", stable=False, energy_mj=2100.0)
    assert "stable at 120 N/m" in touch_text({"left": stable})
    for text in (touch_text({"left": stable}), answer_text(stable)):
        assert "257 N/m" in text
        assert "91 %" in text
    # an unstable hand's slope means nothing
    assert "91 %" not in touch_text({"left": unstable}) + answer_text(unstable)
    assert "2.10 J" in touch_text({"left": unstable})
    assert touch_text({}) == ""


def test_theorys_limit_is_told_with_the_round_trip_at_which_it_holds() -> None:
    words = answer_text(_figures(limit_round_trip_ms=352.0))
    assert "swing from 257 N/m on, at its round trip of 352" in words
    assert "round trip" not in answer_text(_figures())


def test_a_coupling_without_theory_and_tissue_have_no_limit_to_name() -> None:
    assert "theory tells no limit" in stability_text(_figures(limit_n_m=None))
    assert "N/m" not in answer_text(_figures(limit_n_m=None, stiffness_n_m=None, shown_over_true=None))
    assert "not decidable" in stability_text(_figures(stability="not_decidable", stable=None))


def test_the_table_has_packets_and_what_is_not_known() -> None:
    (table,) = touch_tables({"left": _figures(shown_over_true=None)})
    rows = dict(table.texts())
    assert rows["forces"] == "10 sent, 5 kept back by the deadband"
    assert rows["drift of the set point"] == rows["stiffness felt, of the true one"] == "-"
