from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.patient_side.learned.models import LEARNED, learned_model
from tests.patient_side.learning.tracks import turning
from tis.common.errors import InputError
from tis.common.extras import GET_LEARNED
from tis.common.scenario.estimator_names import LearnedName
from tis.common.scenario.identification import Identification, Learning
from tis.common.sources.trajectory import HandRecording, PoseTrack, Recording
from tis.patient_side.estimators.learned_forecast import learned_forecast
from tis.patient_side.identification.identify import identify_hands
from tis.patient_side.identification.model_file import dump_models
from tis.patient_side.learned.gaussian_process import N_FEATURES
from tis.patient_side.learning import fit_gpr, fit_srlsmf
from tis.patient_side.learning import train as module
from tis.patient_side.learning.examples import Examples
from tis.patient_side.learning.fit_network import Epoch
from tis.patient_side.learning.process_scales import Noise, noise_on
from tis.patient_side.learning.train import with_learned
from tis.patient_side.model_fields import Floats
from tis.patient_side.statespace import ArmModel

OTHERS = Identification(train="others", block_rows=4, learning=Learning(epochs=2, passes=1))


def recording(person: str, seed: int, n: int = 500) -> Recording:
    """A person's trial with both hands; each arm is half its master."""

    def hand(side: Any, arm: Any, k: int) -> HandRecording:
        track = turning(seed + k, n)
        level = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
        master = PoseTrack(2.0 * track.position_m, level, track.gripper_rad)
        return HandRecording(side, arm, master, PoseTrack(track.position_m, level, track.gripper_rad))

    hands = (hand("left", "PSM2", 0), hand("right", "PSM1", 100))
    return Recording(f"{person}{seed}", 30, hands, 0, "cross", digest=f"{seed:02x}", person=person)


RECORDINGS = [recording("A", 1), recording("B", 2), recording("C", 3)]


def identified(identification: Identification) -> list[ArmModel]:
    hands: list[Any] = ["left", "right"]
    found = identify_hands(RECORDINGS, hands, identification, "cross", {"innovations_kf"})
    return [each.model for each in found]


@pytest.fixture(scope="module")
def linear() -> list[ArmModel]:
    return identified(OTHERS)


def test_without_names_nothing_changes(linear: list[ArmModel]) -> None:
    assert with_learned(linear, RECORDINGS, OTHERS, []) == tuple(linear)


@pytest.mark.parametrize("names", [["cnn"], ["gpr"], ["srlsmf", "transformer"]])
def test_a_missing_extra_is_named_with_its_command(
    names: list[LearnedName], linear: list[ArmModel], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "find_spec", lambda _: None)
    with pytest.raises(InputError) as caught:
        with_learned(linear, RECORDINGS, OTHERS, names)
    faults = [str(fault) for fault in caught.value.faults]
    assert len(faults) == len(names)
    for name, fault in zip(names, faults, strict=True):
        package = "sklearn" if name in ("gpr", "srlsmf") else "jax and optax"
        assert fault == (f"identification: method: needs {package} to train {name}: {GET_LEARNED}")


@pytest.mark.parametrize("name", LEARNED)
def test_pooled_hands_share_a_model_that_repeats_and_forecasts(name: LearnedName, linear: list[ArmModel]) -> None:
    pytest.importorskip("sklearn", reason="needs the extra learned")
    pytest.importorskip("optax", reason="needs the extra learned")
    epochs: list[Epoch] = []
    first, again = (with_learned(linear, RECORDINGS, OTHERS, [name], progress=epochs.append) for _ in range(2))
    assert first[0].learned[0] is first[1].learned[0]
    assert dump_models(first) == dump_models(again)
    learned = first[0].learned[0]
    assert learned.training.held_out == ("B",)  # the second of three, by the seed 1
    assert len(learned.training.errors) == (2 if name in ("transformer", "informer", "cnn") else 1)
    assert epochs[0].method == name
    assert learned_forecast(name, first[0]).name == name


def test_another_seed_holds_out_somebody_else_and_gives_another_model(linear: list[ArmModel]) -> None:
    pytest.importorskip("sklearn", reason="needs the extra learned")
    other = replace_learning(OTHERS, seed=2)
    first, second = (with_learned(linear, RECORDINGS, each, ["srlsmf"])[0].learned[0] for each in (OTHERS, other))
    assert second.training.held_out == ("C",)
    assert not np.array_equal(first.weights["points"], second.weights["points"])


def replace_learning(identification: Identification, **changes: Any) -> Identification:
    learning = identification.learning.model_copy(update=changes)
    return identification.model_copy(update={"learning": learning})


def test_models_with_weights_are_stored_once_for_both_hands(linear: list[ArmModel]) -> None:
    learned = (learned_model("cnn"),)
    shared = dump_models([replace(each, learned=learned) for each in linear])
    own = [replace(each, learned=(learned_model("cnn", seed),)) for seed, each in enumerate(linear)]
    n_bytes = 4 * sum(weight.size for weight in learned[0].weights.values())
    assert len(dump_models(own)) - len(shared) > 0.95 * n_bytes


@pytest.mark.parametrize("name", ["gpr", "srlsmf"])
def test_the_noise_of_a_process_is_chosen_on_rows_that_it_has_not_learned_from(
    name: LearnedName, linear: list[ArmModel], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Without scikit-learn's length scales the rest needs no extra.
    monkeypatch.setattr(module, "check_extra", lambda _: None)
    monkeypatch.setattr(module, "inverse_lengths", lambda *_: np.full(N_FEATURES, 0.2))
    seen: list[set[int]] = []

    def spied(z: Floats, mean_of: Callable[[Floats], Floats], judged: Examples) -> Noise:
        seen.append(set(judged.groups.tolist()))
        return noise_on(z, mean_of, judged)

    monkeypatch.setattr(fit_gpr if name == "gpr" else fit_srlsmf, "noise_on", spied)
    found = with_learned(linear, RECORDINGS, OTHERS, [name])[0].learned[0]
    assert seen == [{1}]  # once, on B alone, who is held out
    assert found.training.held_out == ("B",)
