"""Attacks on the emergency stop: somebody on the network stops and releases the arms, once or all the time."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import pytest
from mcap.reader import make_reader

from tests.deploy.run.attacker import Attacker, Forged
from tis.common.channels import Side
from tis.common.node import Node
from tis.common.scenario import reading
from tis.common.stop_messages import MAX_IN_FORCE, lock_of
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.logs.read.load import load_run
from tis.deploy.report.contents import run_warnings
from tis.deploy.report.summarise import build_summary
from tis.deploy.report.summary import Summary
from tis.deploy.run.replay import replay
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin
from tis.deploy.shell import run_dir as folder
from tis.patient_side.identification.model_file import dump_models

_STOP, _RELEASE = "tis/@tis/stop", "tis/@tis/release"
_SETTINGS = (
    "estimators=[hold]", "active_estimator=hold", "patient.orientation={methods: [hold], active: hold}",
    "identification.order=2",
)  # fmt: skip
_BEGIN_NS = NS_PER_S


def _request(at_ns: int, key: str, **fields: Any) -> Forged:
    return Forged(at_ns, key, 0, json.dumps(fields).encode())


def _run(run_dir: Path, requests: Sequence[Forged], *settings: str) -> dict[str, Any]:
    scenario = resolve("default", [*_SETTINGS, *settings], None, 6.0)
    nodes, models, _ = build_sides(scenario)
    everybody = cast("dict[Side, Node]", {**nodes, "attacker": Attacker(requests)})
    run_dir.mkdir()
    (run_dir / "scenario.yaml").write_text(reading.dump_scenario(scenario))
    folder.model_file(run_dir).write_bytes(dump_models(models))
    run_twin(scenario, everybody, models, run_dir)
    found = build_summary(load_run(run_dir), scenario, models, "twin", 0, "")
    json.dumps(found, allow_nan=False)
    return found


def _safe_s(summary: dict[str, Any]) -> float:
    return float(summary["safety"]["left"]["time_s"]["safe"])


def _strangers_release(number: int, at_s: float) -> Forged:
    return _request(int(at_s * NS_PER_S), _RELEASE, stop=False, number=number, ends=1, reason="a stranger")


_OPERATORS_STOP = _request(_BEGIN_NS, _STOP, stop=True, number=1, lock=lock_of("known to one"), reason="smoke")


def test_a_strangers_release_of_an_operators_stop_is_told(tmp_path: Path) -> None:
    found = _run(tmp_path / "run", [_OPERATORS_STOP, _strangers_release(2, 2.0)])
    left = found["safety"]["left"]
    assert (left["emergency_stops"], left["releases"], left["releases_by_others"]) == (1, 1, 1)
    assert _safe_s(found) < 2
    assert any(
        "a release came without the stop's token" in text for text in run_warnings(Summary.model_validate(found))
    )
    assert found["valid"], found["problems"]


def test_with_stopper_a_strangers_release_is_refused_and_the_stoppers_is_not(tmp_path: Path) -> None:
    releases = [_strangers_release(2, 2.0), _strangers_release(3, 2.5)]
    own = _request(4 * NS_PER_S, _RELEASE, stop=False, number=4, ends=1, secret="known to one")
    found = _run(tmp_path / "run", [_OPERATORS_STOP, *releases, own], "patient.safety.release=stopper")
    left = found["safety"]["left"]
    assert (left["releases"], left["releases_by_others"], left["stop_requests_refused"]) == (1, 0, 2)
    assert _safe_s(found) == pytest.approx(3.0, abs=0.2)
    assert any(
        "the patient refused 2 requests to stop or to release" in text
        for text in run_warnings(Summary.model_validate(found))
    )
    # the log holds no secret, and the replay needs none
    with (tmp_path / "run" / "patient.mcap").open("rb") as file:
        written = b"".join(message.data for _, _, message in make_reader(file).iter_messages())
    assert b"a stranger" in written
    assert b"known to one" not in written
    assert replay(tmp_path / "run").identical


def test_a_flood_of_stops_and_releases_is_bounded_named_and_replayed(tmp_path: Path) -> None:
    """30 000 requests in 4 s: the arms change their state 20 times at most for each second, and end stopped."""
    requests = []
    for k in range(15_000):
        at_ns = _BEGIN_NS + k * 4 * NS_PER_S // 15_000
        requests.append(_request(at_ns, _STOP, stop=True, number=2 * k + 1))
        requests.append(_request(at_ns + NS_PER_MS // 10, _RELEASE, stop=False, number=2 * k + 2, ends=2 * k + 1))
    found = _run(tmp_path / "run", requests)
    left = found["safety"]["left"]
    assert (left["emergency_stops"], left["releases"]) == (5 + MAX_IN_FORCE + 1, 5)
    assert left["changes"] < 20
    assert left["stop_requests_flooded"] > 29_000
    total = sum(left[name] for name in ("emergency_stops", "releases", "stop_requests_refused"))
    assert total + left["stop_requests_flooded"] <= 30_000
    assert any(text.startswith("a flood of ") for text in run_warnings(Summary.model_validate(found)))
    assert _safe_s(found) > 3
    assert found["valid"], found["problems"]
    assert (tmp_path / "run" / "patient.mcap").stat().st_size < 2_000_000
    assert replay(tmp_path / "run").identical
