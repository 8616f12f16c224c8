"""Two hands identified together, against each hand on its own."""

from collections import Counter
from contextlib import nullcontext
from dataclasses import fields, is_dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import pytest

from tests.patient_side.identification.known_systems import ONE_LAG, Array, hand_like, recording
from tis.common.channels import Hand
from tis.common.estimators import ESTIMATORS
from tis.common.scenario.estimator_names import is_learned
from tis.common.scenario.identification import Identification
from tis.common.sources.trajectory import Recording
from tis.patient_side.identification import companions, identify
from tis.patient_side.identification.identify import identify_arm, identify_hands

HANDS: Final[tuple[Hand, ...]] = ("left", "right")
QUICK: Final = tuple(name for name in ESTIMATORS if name != "drmf" and not is_learned(name))


def pair(seed: int, at_m: float, gain: float = 1.0) -> tuple[Array, Array]:
    u = hand_like(400, seed)
    noise = 1e-5 * np.random.default_rng(seed).normal(size=u.shape)
    return u - at_m, gain * ONE_LAG.simulate(u, u[0] / 2) + noise + at_m


def trials() -> list[Recording]:
    return [recording(f"T{i}", {"left": pair(i, 0.1), "right": pair(i + 10, -0.2)}) for i in (1, 2)]


def of(train: str, **settings: Any) -> Identification:
    return Identification.model_validate({"train": train, "block_rows": 6, **settings})


def assert_same(one: Any, other: Any, where: str = "model") -> None:
    """Compare every array, number and text of two results exactly."""
    if is_dataclass(one):
        assert type(one) is type(other), where
        for field in fields(one):
            assert_same(getattr(one, field.name), getattr(other, field.name), f"{where}.{field.name}")
    elif isinstance(one, np.ndarray):
        assert np.array_equal(one, other), where
    elif isinstance(one, tuple | list):
        assert len(one) == len(other), where
        for i, (a, b) in enumerate(zip(one, other, strict=True)):
            assert_same(a, b, f"{where}[{i}]")
    else:
        assert one == other, where


@pytest.mark.parametrize("train", ["own_head", "others"])
@pytest.mark.parametrize("method", [pytest.param("moesp", marks=pytest.mark.slow), "moesp_paper", "arx"])
def test_each_hand_gets_the_model_that_it_has_on_its_own(train: str, method: str) -> None:
    made, identification = trials(), of(train, method=method)
    # Most models beside the chosen one do not depend on its method.
    wanted = QUICK if method == "moesp" else ("arx_kf", "paper")
    together = identify_hands(made, HANDS, identification, "p", wanted)
    for hand, found in zip(HANDS, together, strict=True):
        assert found.model.hand == hand
        assert_same(found.model, identify_arm(made, hand, identification, "p", wanted))
    left, right = (found.model for found in together)
    assert left.arx is not None
    assert right.arx is not None
    assert not np.allclose(right.arx.input_offset_m, left.arx.input_offset_m)


def test_a_doubt_about_the_arm_names_the_own_hand_and_arm() -> None:
    rng = np.random.default_rng(0)
    made = [recording("T", {hand: (hand_like(400, 1), 0.01 * rng.normal(size=(400, 3))) for hand in HANDS})]
    found = identify_hands(made, HANDS, of("others"), "p")
    for hand, arm, each in zip(HANDS, ("PSM2", "PSM1"), found, strict=True):
        [text] = [text for text in each.model.warnings if "explains only" in text]
        assert f"of {arm}'s x y z" in text
        assert text.endswith(f"it may not be the arm that follows the {hand} hand")


@pytest.mark.parametrize(("train", "n_fits"), [("others", 1), ("own_head", 2)])
def test_pooled_hands_are_identified_once(monkeypatch: pytest.MonkeyPatch, train: str, n_fits: int) -> None:
    counts: Counter[str] = Counter()

    def counted(name: str, fit: Any, *args: Any, **settings: Any) -> Any:
        counts[name] += 1
        return fit(*args, **settings)

    for module, name in ((identify, "fit_subspace"), (companions, "fit_innovations"), (identify, "fit_forecast")):
        monkeypatch.setattr(module, name, partial(counted, name, getattr(module, name)))
    identify_hands(trials(), HANDS, of(train), "p", ["innovations_kf"])
    assert counts == dict.fromkeys(("fit_subspace", "fit_innovations", "fit_forecast"), n_fits)


def test_each_fit_beside_the_chosen_model_is_a_stage() -> None:
    stages = []

    def stage(name: str) -> nullcontext[None]:
        stages.append(name)
        return nullcontext()

    identify_hands(trials(), HANDS, of("others"), "p", ["innovations_kf", "arx_kf", "hold"], stage)
    assert sorted(set(stages)) == ["arx_kf", "innovations_kf"]
