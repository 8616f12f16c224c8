"""Attacks on a run: somebody on the patient's network sends what the surgeon did not."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, cast

import pytest

from common.channels import Network, Side
from common.header import Header
from common.node import Arrival, Emission, Node, Output, Record
from common.runtime.recordings import load_recording
from common.units import NS_PER_MS, NS_PER_S, sample_instant_ns
from deploy.logs.read.load import load_run
from deploy.report.summary import build_summary
from deploy.run.resolve import resolve
from deploy.run.twin import build_sides, run_twin
from tests.nodes import a_pose

COMMAND, ARM = "tis/MTML/measured_cp", "tis/PSM2/setpoint_cp"
RATE_HZ, ATTACK_NS = 30, 4 * NS_PER_S


class Forged(NamedTuple):
    """A message to inject at an instant."""

    at_ns: int
    key: str
    seq: int
    payload: bytes


@dataclass
class Attacker:
    """Sends forged messages at their instants."""

    messages: Sequence[Forged]
    name: str = "attacker"
    _due: list[Forged] = field(init=False)

    def __post_init__(self) -> None:
        self._due = sorted(self.messages, key=lambda one: one.at_ns, reverse=True)

    def listens(self) -> Sequence[tuple[Network, str]]:
        return []

    def publishes(self) -> Sequence[tuple[Network, str]]:
        return []

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        return []

    def next_wake_ns(self) -> int | None:
        return self._due[-1].at_ns if self._due else None

    def wake(self, now_ns: int) -> Iterable[Output]:
        while self._due and self._due[-1].at_ns <= now_ns:
            one = self._due.pop()
            yield Emission("east", one.key, one.payload, Header(one.seq), lambda _: ())

    def finish(self, now_ns: int) -> Sequence[Record]:
        return []

    def counters(self) -> dict[str, int]:
        return {}


def _at(k: int, metres: float) -> bytes:
    """Return a pose ``metres`` off along each axis, with the instant of sample ``k``."""
    return (
        a_pose(sample_ns=sample_instant_ns(k, RATE_HZ))
        .model_dump_json()
        .replace('"position_m":{"x":0.0,"y":0.0,"z":0.0}', f'"position_m":{{"x":{metres},"y":{metres},"z":{metres}}}')
        .encode()
    )


def _pair(at_ns: int, k: int, seq: int, metres: float) -> Iterator[Forged]:
    for key in (COMMAND, ARM):
        yield Forged(at_ns, key, seq, _at(k, metres))


def _now(at_ns: int) -> int:
    return at_ns * RATE_HZ // NS_PER_S


def _stream_ahead() -> Iterator[Forged]:
    """A movement of its own, 0.8 s ahead, for 5 s, under the right numbers."""
    for i in range(150):
        at_ns = ATTACK_NS - 2 * NS_PER_S + i * NS_PER_S // RATE_HZ
        k = _now(at_ns + 800 * NS_PER_MS)
        yield from _pair(at_ns, k, k, 0.05)


ATTACKS: dict[str, tuple[list[Forged], str]] = {
    "one pair 5 m off and 0.9 s ahead, with the last number": (
        [*_pair(ATTACK_NS, _now(ATTACK_NS + 900 * NS_PER_MS), 2**32 - 1, 5.0)], "ahead",
    ),
    "a stream 0.8 s ahead for 5 s": ([*_stream_ahead()], "ahead"),
    "one pair a thousand kilometres off": ([*_pair(ATTACK_NS, _now(ATTACK_NS), _now(ATTACK_NS), 1e6)], "place"),
    "one pair at 1e300 m": ([*_pair(ATTACK_NS, _now(ATTACK_NS), _now(ATTACK_NS), 1e300)], "rejected"),
    "the next 120 numbers, sent early": (
        [one for k in range(124, 244) for one in _pair(ATTACK_NS, k, k, 0.0)], "ahead",
    ),
    "old samples under new numbers": (
        [one for i in range(60) for one in _pair(ATTACK_NS + i, i + 10, i + 150, 0.01)], "number",
    ),
}  # fmt: skip


def _run(run_dir: Path, messages: Sequence[Forged]) -> dict[str, Any]:
    scenario = resolve("default", ["patient.orientation={methods: [hold], active: hold}"], None, 8.0)
    recording = load_recording(scenario)
    nodes, models, _ = build_sides(scenario, recording=recording)
    everybody = cast("dict[Side, Node]", {**nodes, "attacker": Attacker(messages)})
    run_dir.mkdir()
    run_twin(scenario, everybody, models, run_dir, recording)
    summary = build_summary(load_run(run_dir), scenario, models, "twin", 0, "")
    json.dumps(summary, allow_nan=False)
    return summary


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return _run(tmp_path_factory.mktemp("plain") / "run", [])


@pytest.mark.parametrize("name", ATTACKS)
def test_what_the_gate_refuses_changes_no_estimate_and_is_counted(
    tmp_path: Path, undisturbed: dict[str, Any], name: str
) -> None:
    messages, kind = ATTACKS[name]
    found = _run(tmp_path / "run", messages)
    refused = found["quarantined"].get(kind, 0) + found["rejected"]["patient"]
    assert refused == len(messages)
    assert found["accuracy"] == undisturbed["accuracy"]
    for figure in ("sent", "received", "unplanned_loss", "not_sent"):
        assert found["links"]["forward"][figure] == undisturbed["links"]["forward"][figure]
    assert found["valid"], found["problems"]


def test_what_passes_for_a_true_sample_makes_the_run_invalid(tmp_path: Path, undisturbed: dict[str, Any]) -> None:
    """The right instants and numbers, near the arm, before the true samples: only identity could refuse these."""
    messages = [one for k in range(120, 180) for one in _pair(sample_instant_ns(k, RATE_HZ), k, k, 0.02)]
    found = _run(tmp_path / "run", messages)
    assert not found["valid"]
    n_forged = found["links"]["forward"]["not_sent"]
    assert n_forged > 0
    assert any(f"the patient used {n_forged} messages that the surgeon did not send" in p for p in found["problems"])
    assert found["quarantined"]["conflicting"] > 0  # the true samples, under numbers that were taken
