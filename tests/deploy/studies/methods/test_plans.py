"""Plans: who is trained on whom, under which networks; nothing is computed here."""

from dataclasses import replace

import pytest

from tis.deploy.compare.cells.cell import Training
from tis.deploy.compare.plan import Plan
from tis.deploy.studies.methods.plans import (
    ALL,
    OTHER_PERSON,
    OWN,
    Measure,
    Subject,
    losses_of,
    merged,
    plans_of,
)
from tis.deploy.studies.methods.trials import QUICK, WHOLE, Trials

EXTENT = replace(QUICK, n_people=None, duration_s=None, n_training_trials=(1, 3, 8))


@pytest.fixture(scope="module")
def planned(people: Trials) -> dict[Measure, Plan]:
    return plans_of(Subject("arx_kf", people, EXTENT, 7))


def trained_on(training: Training, tested: str, people: Trials) -> set[str]:
    """Return the trials that a training reads, by the rule of `load_training` where it names none."""
    others = {name for name in people.names if name[0] != tested[0]}
    return others if training.trials is None else set(training.trials)


def test_nobody_is_tested_on_models_of_ones_own_trials_but_where_that_is_the_point(
    planned: dict[Measure, Plan], people: Trials
) -> None:
    for measure, plan in planned.items():
        for cell in plan.cells if measure != "fast" else ():  # a model of the hand's own first rows
            assert cell.training is not None
            used = trained_on(plan.trainings[cell.training], cell.trial, people)
            if cell.setting == OWN:
                assert {name[0] for name in used} == {cell.trial[0]}
                assert cell.trial not in used
            elif cell.setting != "Knot_Tying":
                assert cell.trial[0] not in {name[0] for name in used}, measure


def test_fewer_training_trials_are_part_of_more_and_all_is_what_the_accuracy_has(
    planned: dict[Measure, Plan], people: Trials
) -> None:
    plan = planned["data"]
    by_setting = {
        (cell.setting, cell.trial): trained_on(plan.trainings[cell.training or ""], cell.trial, people)
        for cell in plan.cells
    }
    assert [point.label for point in plan.points] == ["1", "3", ALL]  # eight are not there
    for trial in people.few(None):
        one, three, whole = (by_setting[n, trial] for n in ("1", "3", ALL))
        assert one < three < whole
        assert (len(one), len(three), len(whole)) == (1, 3, 4)
    same = {cell.digest for cell in plan.cells if cell.setting == ALL}
    assert same <= {cell.digest for cell in planned["accuracy"].cells if cell.setting == "100"}
    assert same == {cell.digest for cell in planned["noise"].cells if cell.setting == "0"}


def test_another_person_and_another_task_give_as_many_trials_as_ones_own(planned: dict[Measure, Plan]) -> None:
    plan = planned["adaptability"]
    assert [point.label for point in plan.points] == [OWN, OTHER_PERSON, "Knot_Tying"]
    for cell in plan.cells:
        training = plan.trainings[cell.training or ""]
        assert training.trials is not None
        source = training.scenario.source
        assert source.kind == "jigsaws"
        elsewhere = cell.setting == "Knot_Tying"
        assert (source.task, len(training.trials)) == (("Knot_Tying", 2) if elsewhere else ("Suturing", 1))


def test_the_networks_lose_what_they_say(planned: dict[Measure, Plan]) -> None:
    kinds = {}
    for cell in planned["loss"].cells:
        loss = cell.scenario.network.forward.loss
        assert loss is not None
        kinds[cell.setting] = (loss.kind, getattr(loss, "p_loss", None), getattr(loss, "mean_burst", None))
    assert list(kinds.values()) == [("bernoulli", 0.0, None), ("bernoulli", 0.2, None), ("burst", 0.2, 8.0)]
    assert losses_of(WHOLE) == [
        *((pct, False) for pct in (0, 1, 5, 10, 20, 30)),
        *((pct, True) for pct in (1, 5, 10, 20, 30)),
    ]


def test_noise_is_on_what_is_sent_and_then_on_the_training_rows_too(planned: dict[Measure, Plan]) -> None:
    def noises(measure: Measure) -> list[tuple[float, float]]:
        found = [cell.scenario for cell in planned[measure].cells]
        return sorted({(each.surgeon.sensor_noise_mm, each.identification.sensor_noise_mm) for each in found})

    assert noises("noise") == [(0.0, 0.0), (2.0, 0.0)]
    assert noises("noise_trained") == [(0.0, 0.0), (2.0, 2.0)]
    assert noises("accuracy") == [(0.0, 0.0)]


def test_the_size_of_the_models_follows_the_block_rows(planned: dict[Measure, Plan]) -> None:
    plan = planned["size"]
    sizes = {cell.setting: plan.trainings[cell.training or ""].scenario.identification for cell in plan.cells}
    assert {name: (each.block_rows, each.order) for name, each in sizes.items()} == {"5": (5, 5), "10": (10, 10)}


def test_a_learned_method_is_trained_anew_for_each_seed(people: Trials) -> None:
    plan = plans_of(Subject("gpr", people, replace(EXTENT, n_seeds=3), 7))["accuracy"]
    trained = {
        (cell.trial[0], plan.trainings[cell.training or ""].scenario.identification.learning.seed)
        for cell in plan.cells
    }
    assert trained == {(who, seed) for who in "STU" for seed in (1, 2, 3)}
    assert len(plan.trainings) == 9
    assert {cell.setting for cell in plan.cells} == {"100", "500"}
    assert len(plan.cells) == 2 * 3 * len(people.names)


def test_a_learned_method_is_trained_with_the_greatest_noise_only(people: Trials) -> None:
    extent = replace(EXTENT, noises_mm=(0, 1, 2))
    plans = plans_of(Subject("gpr", people, extent, 7))
    found = {
        (cell.scenario.surgeon.sensor_noise_mm, cell.scenario.identification.sensor_noise_mm)
        for cell in plans["noise_trained"].cells
    }
    assert found == {(0.0, 0.0), (2.0, 2.0)}
    assert {cell.scenario.surgeon.sensor_noise_mm for cell in plans["noise"].cells} == {0.0, 1.0, 2.0}


def test_every_training_names_its_method_and_each_unit_is_computed_once(planned: dict[Measure, Plan]) -> None:
    whole = merged(list(planned.values()))
    assert all(training.label.startswith("arx_kf, ") for training in whole.trainings.values())
    assert len({cell.digest for cell in whole.cells}) == len(whole.cells)
    assert {cell.digest for plan in planned.values() for cell in plan.cells} == {c.digest for c in whole.cells}
    assert {cell.training for cell in whole.cells} == set(whole.trainings)


def test_the_twins_of_a_method_do_not_depend_on_the_others(people: Trials, planned: dict[Measure, Plan]) -> None:
    other = plans_of(Subject("damped_velocity", people, EXTENT, 7))
    assert {cell.digest for cell in planned["loss"].cells}.isdisjoint(cell.digest for cell in other["loss"].cells)
    assert all(cell.scenario.estimators == ("hold", "arx_kf") for cell in planned["loss"].cells)


def test_at_1_khz_a_synthetic_hand_is_scored_after_the_rows_it_was_trained_on(planned: dict[Measure, Plan]) -> None:
    (cell,) = planned["fast"].cells
    assert (cell.scenario.rate_hz, cell.scenario.source.kind) == (1000, "synthetic")
    assert cell.scenario.identification.train == "own_head"
    assert cell.scenario.identification.train_samples == 6000


def test_at_1_khz_a_learned_method_has_rows_for_its_furthest_forecasts(people: Trials) -> None:
    (cell,) = plans_of(Subject("gpr", people, EXTENT, 7))["fast"].cells
    assert cell.scenario.identification.train_samples == 20000
