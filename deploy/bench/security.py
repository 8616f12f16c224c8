"""Benchmark of security (`tis bench security`): the price of passwords and TLS for latency and processor time.

The scenario ``default``, without impairments of its network, runs live with each kind of security in turn, so that
other load of the machine affects all equally.
"""

import os
import tempfile
from pathlib import Path
from statistics import median
from typing import Any, Final, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from tis.common.channels import FOLLOWER, Side
from tis.common.errors import EXIT_OK, DataError, Fault
from tis.common.host_records import PROCESSORS
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_MS
from tis.deploy.logs.read.load import load_run
from tis.deploy.present.table import SIMPLE, Column, Table
from tis.deploy.report.subjects.latency import sample_latency, used_samples
from tis.deploy.run.resolve import resolve
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.launch import launch
from tis.deploy.tools.certificates import issue, new_authority

_KINDS: Final = ("none", "password", "mtls")
_SETTINGS: Final = (
    "estimators=[hold]", "active_estimator=hold", "network={}", "rate_hz=200", "patient.tick=on_arrival",
)  # fmt: skip


class Price(NamedTuple):
    """Cost of one run: medians end to end and of the network, in ms, and netem's share of a processor, in %."""

    end_to_end_ms: float
    network_ms: float
    netem_cpu_pct: float


def bench_security(seconds: float, rounds: int, out: Console) -> dict[str, Any]:
    """Run each kind of security ``rounds`` times, ``seconds`` each; print and return the medians over the rounds."""
    found: dict[str, list[Price]] = {kind: [] for kind in _KINDS}
    with tempfile.TemporaryDirectory() as scratch:
        secrets = _secrets(Path(scratch))
        for k in range(rounds):
            for kind in _KINDS[k % 3 :] + _KINDS[: k % 3]:
                scenario = resolve("default", (*_SETTINGS, f"security={secrets[kind]}"), None, seconds)
                found[kind].append(_run(scenario, Path(scratch) / f"{kind}{k}"))
            load = os.getloadavg()[0]
            out.print(f"round {k + 1}: {'; '.join(_text(kind, found[kind][-1]) for kind in _KINDS)}; load {load:.1f}")
    middle = {kind: Price(*map(median, zip(*prices, strict=True))) for kind, prices in found.items()}
    rows = []
    for kind, price in middle.items():
        slower, dearer = (price[i] / middle["none"][i] for i in (0, 2))
        latency = (f"{price.end_to_end_ms:.3f} ms", f"{price.network_ms:.3f} ms")
        rows.append((kind, *latency, f"{price.netem_cpu_pct:.1f} %", f"{slower:.2f} x", f"{dearer:.2f} x"))
    heads = ("security", "end to end", "network", "netem's CPU", "end to end beside none", "CPU beside none")
    columns = [Column(head, words=head == "security", wraps=True) for head in heads]
    out.print(Table(f"Medians of {rounds} runs of {seconds:g} s at 200 Hz", columns, rows).terminal(SIMPLE))
    figures: dict[str, Any] = {kind: price._asdict() for kind, price in middle.items()}
    return {"seconds": seconds, "rounds": rounds, **figures}


def _secrets(scratch: Path) -> dict[str, str]:
    """Make certificates and passwords; return the scenario's ``security`` of each kind, in YAML."""
    new_authority(scratch / "certs")
    for name in get_args(Side):
        issue(scratch / "certs", name)
    passwords = scratch / "passwords.txt"
    passwords.touch(mode=0o600)
    passwords.write_text("".join(f"{name}:{name}\n" for name in get_args(Side)))
    return {
        "none": "{kind: none}",
        "password": f"{{kind: password, file: {passwords}}}",
        "mtls": f"{{kind: mtls, folder: {scratch / 'certs'}}}",
    }


def _run(scenario: Scenario, where: Path) -> Price:
    """Return the cost of a live run; raises `DataError` when it fails."""
    run_dir = folder.create(where, scenario)
    outcome = launch(scenario, run_dir, lambda _: None)
    if outcome.exit_code != EXIT_OK:
        raise DataError(Fault("tis bench security", "", f"the run failed: {'; '.join(outcome.reasons)}"))
    logs = load_run(run_dir)
    parts = sample_latency(used_samples(logs, scenario.session, {"left": FOLLOWER["left"]}))
    [note] = logs.of("netem", PROCESSORS)
    share = note["own_ns"] / (note["to_ns"] - note["from_ns"])
    return Price(_median_ms(parts.end_to_end), _median_ms(parts.network), 100.0 * share)


def _median_ms(durations_ns: NDArray[Any]) -> float:
    return float(np.median(durations_ns)) / NS_PER_MS


def _text(kind: str, price: Price) -> str:
    return f"{kind} {price.end_to_end_ms:.3f} ms, {price.netem_cpu_pct:.1f} % CPU"
