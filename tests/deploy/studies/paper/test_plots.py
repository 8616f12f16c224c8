"""The paper's plots: what they draw, from a trial that the test writes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.deploy.studies.paper.test_page import made_up_results
from tis.common.extras import GET_REPORT
from tis.deploy.report.publication.matplotlib_figures import rendered
from tis.deploy.studies.paper.cells import Results, Trial
from tis.deploy.studies.paper.plots import drawn, energy_order
from tis.deploy.tools.synth import write_trials


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    folder = tmp_path_factory.mktemp("paper") / "trials"
    write_trials(folder, 1, "Suturing", 1, 1400 / 30, "a test")
    made_up = made_up_results(90.0)
    singular = {
        key: replace(model, singular_values=np.array([6.0, 3.0, 1.0])) for key, model in made_up.models.items()
    }
    return replace(made_up, trial=Trial(str(folder), "Suturing", "S001", 7), models=singular)


def test_positions_are_those_of_the_arm_and_of_algorithm_1_in_units_of_the_range(results: Results) -> None:
    from tis.common.runtime.recordings import load_recording
    from tis.deploy.studies.paper.cells import scenario_of

    same_name, _, _ = drawn(results)
    model = results.models["same_name", "moesp_paper"]
    arm_m = load_recording(scenario_of(results.trial, "same_name")).hands[0].follower.position_m
    assert [axes.get_ylabel() for axes in same_name.axes] == ["position x", "position y", "position z"]
    for axis, axes in enumerate(same_name.axes):
        arm, estimate, border = axes.lines
        span = model.output_high_m[axis] - model.output_low_m[axis]
        assert np.allclose(np.asarray(arm.get_ydata()) * span + model.output_low_m[axis], arm_m[:, axis])
        # a model without states stays at its operating point
        still = (model.output_offset_m[axis] - model.output_low_m[axis]) / span
        assert np.allclose(np.asarray(estimate.get_ydata()), still)
        assert np.asarray(border.get_xdata())[0] == pytest.approx(1240 / 30)


def test_singular_values_are_drawn_with_both_orders(results: Results) -> None:
    *_, singular = drawn(results)
    for axes in singular.axes:
        values, paper, energy = axes.lines
        assert np.asarray(values.get_ydata()).tolist() == [6.0, 3.0, 1.0]
        assert (np.asarray(paper.get_xdata())[0], np.asarray(energy.get_xdata())[0]) == (10, 2)  # 9 of 10 is 90 %


def test_a_figure_is_the_same_file_each_time(results: Results) -> None:
    assert rendered(drawn(results)[2], "svg") == rendered(drawn(results)[2], "svg")


@given(st.lists(st.floats(0.01, 100), min_size=1, max_size=12))
def test_the_energy_order_is_the_first_that_reaches_85_per_cent(values: list[float]) -> None:
    order = energy_order(np.array(values))
    assert sum(values[:order]) >= (0.85 - 1e-9) * sum(values)
    assert sum(values[: order - 1]) < (0.85 + 1e-9) * sum(values)


def test_without_matplotlib_the_page_is_written_and_the_extra_is_named(
    tmp_path: Path, results: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    import io

    from rich.console import Console

    from tis.deploy.studies.paper import command

    monkeypatch.setattr(command, "find_spec", lambda _: None)
    monkeypatch.setattr(command, "compute", lambda *_: results)
    err = Console(file=io.StringIO(), width=200)
    code = command.write_paper(results.trial, tmp_path / "page.md", tmp_path / "figures", True, 1, err, err)
    assert code == 0
    assert (tmp_path / "page.md").exists()
    assert f"no figures without matplotlib: {GET_REPORT}" in err.file.getvalue()  # type: ignore[attr-defined]
    assert not list((tmp_path / "figures").glob("*.svg"))
