"""A run whose network was changed while it lasted, and its twin: the changes are made again (L1)."""

import json
from pathlib import Path
from typing import Any

from msgspec import convert

from tis.common.records import CONTROL, ControlNote
from tis.common.scenario import Scenario
from tis.common.scenario.reading import build_scenario, dump_scenario
from tis.deploy.logs.read.load import load_run
from tis.deploy.logs.read.packets import link_fates
from tis.deploy.logs.read.side_log import OUTCOMES
from tis.deploy.run.consistency import compare_fates
from tis.deploy.run.twin import build_sides, run_twin
from tis.netem.build import build_netem
from tis.netem.control.control import Control

MS = 1_000_000


def _scenario() -> Scenario:
    raw: dict[str, Any] = {
        "version": 1, "name": "changed", "duration_s": 4, "source": {"kind": "synthetic"},
        "estimators": ["hold"], "active_estimator": "hold",
        "network": {"forward": {"delay": {"kind": "uniform", "low_ms": 2, "high_ms": 20}}},
    }  # fmt: skip
    return build_scenario(raw, "changed.yaml")


def _notes(scenario: Scenario) -> list[ControlNote]:
    """Return what a control would have noted, had it been asked then."""
    control = Control({link.direction: link for link in build_netem(scenario).links.values()})
    asked: list[tuple[int, str, Any]] = [
        (1_000_300_000, "set", {"direction": "both", "change": {"loss": {"kind": "bernoulli", "p_loss": 0.4}}}),
        (1_500_000_000, "set", {"direction": "forward", "change": {"scale_delay": 3}, "ramp_s": 0.5}),
        (2_200_000_000, "outage", {"for_ms": 300}),
        (3_000_000_001, "reset", {}),
        (4_900_000_000, "outage", {"for_ms": 5}),  # after the last packet
    ]
    notes = []
    for at_ns, operation, request in asked:
        _, (record,) = control.handle(operation, json.dumps(request).encode(), at_ns)
        assert isinstance(record.data, ControlNote)
        assert record.data.accepted
        notes.append(record.data)
    return notes


def _run(scenario: Scenario, notes: list[ControlNote], path: Path) -> Path:
    nodes, models, _ = build_sides(scenario, notes)
    path.mkdir()
    (path / "scenario.yaml").write_text(dump_scenario(scenario))
    run_twin(scenario, nodes, models, path)
    return path


def test_the_twin_makes_the_changes_of_the_run_again(tmp_path: Path) -> None:
    scenario = _scenario()
    notes = _notes(scenario)
    live, twin, plain = (
        load_run(_run(scenario, made, tmp_path / name))
        for name, made in (("live", notes), ("twin", notes), ("plain", []))
    )
    fates = link_fates(live, "forward")
    silent = (fates.offered_ns >= 2_201 * MS) & (fates.offered_ns < 2_501 * MS)
    assert {OUTCOMES[i] for i in fates.outcome[silent]} == {"outage"}
    assert "outage" not in {OUTCOMES[i] for i in fates.outcome[~silent]}
    logged = [convert(row, ControlNote) for row in live.of("netem", CONTROL)]
    assert logged == notes
    assert [convert(row, ControlNote) for row in twin.of("netem", CONTROL)] == notes

    found = compare_fates(live, twin, scenario)
    assert found.identical
    assert (found.n_different, found.n_set_aside, found.n_in_one_only) == (0, 0, 0)
    without = compare_fates(live, plain, scenario)
    assert without.n_set_aside > 0.7 * found.n_compared  # nothing can be said from the first change on
