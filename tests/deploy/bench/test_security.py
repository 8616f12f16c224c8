import io
from pathlib import Path

import pytest
from rich.console import Console

from tis.common.runtime.credentials import credentials
from tis.common.scenario import Scenario
from tis.deploy.bench import security
from tis.deploy.bench.security import Price, bench_security


def test_each_kind_runs_as_often_with_credentials_that_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[str] = []

    def price(scenario: Scenario, where: Path) -> Price:
        kind = scenario.security.kind
        for side in ("surgeon", "netem", "patient"):
            assert bool(credentials(scenario.security, side)) == (kind != "none")
        ran.append(kind)
        return {"none": Price(2.0, 1.0, 10.0), "password": Price(2.0, 1.0, 11.0), "mtls": Price(3.0, 1.5, 12.0)}[kind]

    monkeypatch.setattr(security, "_run", price)
    out = io.StringIO()
    figures = bench_security(1.0, 3, Console(file=out, width=120))
    assert ran == ["none", "password", "mtls", "password", "mtls", "none", "mtls", "none", "password"], "interleaved"
    assert figures["mtls"] == {"end_to_end_ms": 3.0, "network_ms": 1.5, "netem_cpu_pct": 12.0}
    [row] = [line for line in out.getvalue().splitlines() if line.strip().startswith("mtls")]
    assert row.split() == ["mtls", "3.000", "ms", "1.500", "ms", "12.0", "%", "1.50", "x", "1.20", "x"]
