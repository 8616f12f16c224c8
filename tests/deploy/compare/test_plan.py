"""What is asked for, and the cells that it means."""

from pathlib import Path

import pytest

from tis.common.errors import DataError, InputError
from tis.deploy.compare.grid import Sweep, parse_sweep
from tis.deploy.compare.plan import Plan, Request, make_plan


def _plan(small: Path, *settings: str, **changes: object) -> Plan:
    return make_plan(Request(str(small), settings, **changes))  # type: ignore[arg-type]


def _fault(small: Path, error: type[InputError | DataError], *settings: str, **changes: object) -> str:
    with pytest.raises(error) as caught:
        _plan(small, *settings, **changes)
    return str(caught.value)


def test_all_trials_from_their_beginning_to_their_end_trained_on_the_other_subjects(small: Path) -> None:
    plan = _plan(small)
    assert [cell.label for cell in plan.cells] == ["S001, seed 1", "T002, seed 1"]
    assert plan.trained_on == "the same task by all other subjects"
    assert {cell.scenario.identification.train for cell in plan.cells} == {"others"}
    assert {cell.scenario.n_samples for cell in plan.cells} == {499}
    assert sorted(training.label for training in plan.trainings.values()) == [
        "all subjects but S",
        "all subjects but T",
    ]


def test_a_training_that_is_named_is_kept_and_the_run_begins_behind_its_rows(small: Path) -> None:
    plan = _plan(small, "identification.train=own_head", trials=("T002",))
    (cell,) = plan.cells
    assert cell.scenario.n_samples == 500 - 240 - 1
    assert [training.label for training in plan.trainings.values()] == ["the head of T002"]


def test_seeds_change_the_network_and_not_the_training(small: Path) -> None:
    plan = _plan(small, n_seeds=3, seed=10, duration_s=5.0)
    assert [cell.scenario.seed for cell in plan.cells] == [10, 11, 12, 10, 11, 12]
    assert {cell.scenario.duration_s for cell in plan.cells} == {5.0}
    assert len(plan.trainings) == 2
    assert len({cell.digest for cell in plan.cells}) == 6


def test_a_sweep_gives_each_value_its_cells_and_shares_what_it_does_not_touch(small: Path) -> None:
    plan = _plan(small, sweeps=(parse_sweep("network.forward.delay.delay_ms=33, 100"),), trials=("S001",))
    assert [point.label for point in plan.points] == ["33", "100"]
    delays = [cell.scenario.network.forward.delay for cell in plan.cells]
    assert [delay.delay_ms for delay in delays if delay is not None and delay.kind == "constant"] == [33.0, 100.0]
    assert len(plan.trainings) == 1
    plan = _plan(small, sweeps=(Sweep("identification.train_samples", ("200", "300")),), trials=("S001",))
    assert len(plan.trainings) == 2


def test_of_a_synthetic_source_the_seeds_are_the_trials() -> None:
    plan = make_plan(Request("default", n_seeds=3))
    assert plan.trials == ("synthetic 7", "synthetic 8", "synthetic 9")
    assert len(plan.trainings) == 3
    assert plan.trained_on == "the rows of each trial before its start"


def test_a_digest_is_of_what_decides_and_of_nothing_else(small: Path, written_trials: Path, tmp_path: Path) -> None:
    def digests(*settings: str, **changes: object) -> list[str]:
        return [cell.digest for cell in _plan(small, *settings, trials=("S001",), **changes).cells]

    usual = digests()
    assert digests() == usual
    elsewhere = tmp_path / "elsewhere"
    elsewhere.symlink_to(written_trials)
    assert digests(f"source.path={elsewhere}", "name=other", "limits.p_loss_max=0.01") == usual
    for change in ("seed=2", "network.forward.delay.delay_ms=101", "identification.order=1", "surgeon.copies=2"):
        assert digests(change) != usual, change
    assert digests(estimators=("hold",)) != usual
    trace = tmp_path / "trace.csv"
    recorded = f"network.forward.delay={{kind: trace, path: {trace}}}"
    found = set()
    for delay_ms in (10, 20):
        trace.write_text(f"sent_s,delay_ms\n0,{delay_ms}\n1,{delay_ms}\n")
        found |= set(digests(recorded))
    assert len(found) == 2 * len(usual)


def test_a_trial_too_short_is_set_aside_with_the_reason(small: Path) -> None:
    plan = _plan(small, "identification={train: own_head, train_samples: 600}")
    assert plan.cells == ()
    assert len(plan.refused) == 2
    assert "is too short to compare on: 500 rows, and the run begins at row 600" in str(plan.refused[0])


def test_mistakes_are_named_with_what_there_is(small: Path, tmp_path: Path) -> None:
    fault = _fault(small, InputError, estimators=("hold", "damped_velocty", "fnord"))
    assert "tis compare: --estimators: no such estimator, did you mean 'damped_velocity'" in fault
    assert "no such estimator; there are hold, " in fault
    fault = _fault(small, InputError, trials=("S001", "X009"))
    assert fault == "tis compare: --trials: no such Suturing trial; there are S001, T002 (got 'X009')"
    fault = _fault(small, DataError, "source.task=Knot_Tying")
    assert "Knot_Tying/kinematics/AllGestures: does not exist (folder given by source.path)" in fault
    fault = _fault(small, DataError, "identification.train=absent.json")
    assert fault == "absent.json: cannot be read: No such file or directory"
    with pytest.raises(InputError, match="requires recordings: for a synthetic source use --seeds"):
        make_plan(Request("default", trials=("D002",)))
    with pytest.raises(InputError, match=r"^--sweep: surgeon\.copies: must be at least 1 \(got 0\)$"):
        make_plan(Request("default", sweeps=(Sweep("surgeon.copies", ("1", "0")),)))


def test_the_variable_is_named_by_which_no_trial_was_found(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TIS_JIGSAWS", str(tmp_path / "nowhere"))
    fault = _fault(small, DataError, "source.path=null")
    assert "nowhere/Suturing/kinematics/AllGestures: does not exist (folder given by TIS_JIGSAWS). JIGSAWS (" in fault
    (tmp_path / "nowhere/Suturing/kinematics/AllGestures").mkdir(parents=True)
    fault = _fault(small, DataError, "source.path=null")
    assert "AllGestures: contains no Suturing trial (folder given by TIS_JIGSAWS)" in fault


@pytest.mark.parametrize("text", ["", "a.b", "a.b=", "a..b=1", "=1,2", "a.b=1,,2", "a.b=1,1"])
def test_a_sweep_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"must read a\.b=VALUE"):
        parse_sweep(text)


def test_a_misspelt_field_is_one_fault_at_any_number_of_values() -> None:
    values = tuple(str(value) for value in range(1, 1001))
    with pytest.raises(InputError) as caught:
        make_plan(Request("default", sweeps=(Sweep("network.backward.delay.delay_ms", values),)))
    assert len(caught.value.faults) == 1
    assert "backward" in str(caught.value.faults[0])
