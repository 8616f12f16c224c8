"""User-defined estimators: their origin, and their failures."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final

from tis.common.records import ESTIMATOR_FAULTS, FAULTY_STEPS
from tis.common.scenario import Scenario
from tis.common.scenario.estimator_names import is_user_defined
from tis.common.units import NS_PER_S
from tis.deploy.logs.read.load import RunLogs, origins_in
from tis.deploy.present.numbers import counted
from tis.deploy.report.section import Section, means
from tis.deploy.report.subjects.logs import counters_of


class FirstFault(Section):
    """The first failure of an estimator."""

    at_s: float = means("Run time.")
    hand: str = means("Hand.")
    reason: str = means("Reason.")


class OwnEstimator(Section):
    """Origin and failures of a user-defined estimator."""

    file: str | None = means("File that it was imported from.")
    sha256: str | None = means("Digest of that file.")
    beside: dict[str, str] = means("Digests of the modules that it imported from the same folder.")
    distribution: str | None = means("Distribution that it was installed from.")
    version: str | None = means("Version of that distribution.")
    faulty_steps: int | None = means("Steps in which it failed, of all hands.")
    first_fault: FirstFault | None = means("First failure; `null` when it never failed.")

    @property
    def failed(self) -> bool:
        """Tell whether it failed in any step."""
        return self.first_fault is not None or bool(self.faulty_steps)


_UNKNOWN: Final[Mapping[str, Any]] = {
    "file": None,
    "sha256": None,
    "beside": {},
    "distribution": None,
    "version": None,
}


def own_estimators(logs: RunLogs, scenario: Scenario) -> dict[str, OwnEstimator]:
    """Return each estimator's origin, ``faulty_steps`` of all hands, and ``first_fault``.

    ``faulty_steps`` is None when the log lost its counters; ``first_fault`` has ``at_s``, ``hand`` and ``reason``, or
    is None without a fault. Oracle: an estimator that fails at known ticks, test_own_estimator.
    """
    names = [name for name in scenario.estimators if is_user_defined(name)]
    if not names:
        return {}
    origins = origins_in(logs)
    counters = counters_of(logs, "patient")
    first: dict[str, FirstFault] = {}
    for row in sorted(logs.of("patient", ESTIMATOR_FAULTS), key=lambda row: int(row["t_ns"])):
        about = FirstFault(at_s=row["t_ns"] / NS_PER_S, hand=row["hand"], reason=row["reason"])
        first.setdefault(row["estimator"], about)
    return {
        name: OwnEstimator(
            **(asdict(origins[name]) if name in origins else _UNKNOWN),
            faulty_steps=counters.get(f"{FAULTY_STEPS}.{name}"),
            first_fault=first.get(name),
        )
        for name in names
    }


def estimator_fault_texts(own: Mapping[str, OwnEstimator]) -> list[str]:
    """Return a line for each estimator that failed; the other figures of the run stay valid."""
    texts = []
    for name, about in own.items():
        first, n_steps = about.first_fault, about.faulty_steps
        if not about.failed:
            continue
        times = "at times" if n_steps is None else f"in {counted(n_steps, 'step')}"
        text = f"* {name} failed {times}: no estimate there, where hold's is scored in its place"
        if first is not None:
            text += f"; first at {first.at_s:.3f} s, {first.hand} hand: {first.reason}"
        texts.append(text)
    return texts
