"""Summary of a standalone netem: the links' part of a run's ``summary.json``, under the same names."""

from typing import Any, get_args

from common.channels import Direction
from common.records import COUNTERS
from common.units import NS_PER_S
from deploy.logs.read.batches import link_fates, link_releases
from deploy.report.link_summary import link_summary
from deploy.report.measures.network.link_books import against_counters, counted, counter
from deploy.report.measures.processors import processors_summary
from deploy.standalone.standalone_run import StandaloneRun

KIND = "standalone netem"


def build_summary(run: StandaloneRun, exit_code: int | None) -> dict[str, Any]:
    """Return the requested, decided and realised figures of each link with the verdict; unknown values are null.

    Unknown are only values from senders' and receivers' logs: ``sent``, ``received``, losses outside netem.
    Oracle: a real bridge between two clients, tests/deploy/standalone.
    """
    logs, log = run.logs, run.log
    problems = [f"netem: {text}"] if (text := log.coverage.problem) else []
    links: dict[str, Any] = {}
    for direction in get_args(Direction):
        links[direction], faults = link_summary(logs, direction, run.request)
        problems += faults
        counts = counted((link_fates(logs, direction),), (link_releases(logs, direction),))
        problems += [f"links.{direction}: {text}" for text in against_counters(logs, direction, counts)]
    if leaks := counter(logs, "leaks"):
        ways = "1 way past netem was" if leaks == 1 else f"{leaks} ways past netem were"
        problems.append(f"{ways} found: messages crossed without it")
    return {
        "kind": KIND,
        "seed": run.request.seed,
        "keys": list(run.request.keys),
        "profile": run.request.network.from_profile,
        "mode": "live",
        "exit": exit_code,
        "command": run.about.get("command", ""),
        "begun": run.about.get("begun"),
        "versions": run.versions,
        "duration_s": log.last_ns / NS_PER_S,
        "complete": bool(log.of(COUNTERS)),
        "links": links,
        "processors": processors_summary(logs, ("netem",)),
        "problems": problems,
        "valid": not problems,
    }
