"""Benchmark of cells (`tis bench cells`): processor time of a twin with log files, with logs in memory, and without.

All three are twins of one scenario, whose recording is there before. The kinds take turns, and the least time of each
counts, which leaves out other load of the machine. The twin without logs finds messages, models and estimators of the
round before, as most cells of a comparison do; a twin with logs makes its own, as each of them does.
"""

import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from rich.console import Console

from tis.common.runtime.recordings import load_recording
from tis.deploy.compare.cells.scores import logged_scores, unlogged_scores
from tis.deploy.present.table import Column, Row, Table
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin
from tis.patient_side.build import identify_models
from tis.patient_side.identification.model_file import dump_models

_NETWORK: Final = (
    "network={forward: {loss: {kind: gilbert_elliott, p_bad: 0.01, p_good: 0.2}, delay: {kind: uniform, low_ms: 50, "
    "high_ms: 150}}}"
)
_ESTIMATORS: Final = (("hold", "innovations_kf"), ("hold", "damped_velocity", "moesp_kf", "innovations_kf"))


def bench_cells(seconds: float, rounds: int, out: Console) -> dict[str, Any]:
    """Measure twins of ``seconds``, print a table, and return its figures by estimators."""
    rows: list[Row] = []
    figures: dict[str, Any] = {}
    for names in _ESTIMATORS:
        least_s = _measured(seconds, rounds, names)
        reference_s = least_s["log files"]
        for i, (kind, spent_s) in enumerate(least_s.items()):
            cells = (f"{spent_s:.3f}", f"{seconds / spent_s:.0f}", f"{spent_s / reference_s:.3f}")
            rows.append(("" if i else ", ".join(names), kind, *cells))
        rows.append(())
        figures[",".join(names)] = least_s
    columns = [Column(head, words=True, wraps=True) for head in ("estimators", "twin with")]
    columns += [Column(head) for head in ("CPU, s", "× real time", "of the first")]
    out.print(Table(f"a twin of {seconds:g} s, one hand, 30 Hz", columns, rows).terminal())
    return figures


def _measured(seconds: float, rounds: int, names: tuple[str, ...]) -> dict[str, float]:
    """Return the least processor time of each kind of twin, s."""
    estimators = (f"estimators=[{', '.join(names)}]", f"active_estimator={names[-1]}")
    settings = (f"duration_s={seconds}", *estimators, _NETWORK)
    scenario = resolve("default", (*settings, "identification.train_samples=3600"), None, None)
    with tempfile.TemporaryDirectory() as folder:
        # The models, which are no part of a twin's time.
        recording = load_recording(scenario)
        models = identify_models(scenario, recording, [recording.head(scenario.identification.train_samples)])
        file = Path(folder) / "model.json"
        file.write_bytes(dump_models(models))
        trained = (f"identification={{train: {file}}}", "source.start=3600")
        scenario = resolve("default", (*settings, *trained), None, None)

        def with_files() -> None:
            nodes, own, _ = build_sides(scenario, recording=recording)
            run_twin(scenario, nodes, own, Path(tempfile.mkdtemp(dir=folder)), recording)

        kinds: Mapping[str, Callable[[], Any]] = {
            "log files": with_files,
            "logs in memory": lambda: logged_scores(scenario, recording),
            "no logs": lambda: unlogged_scores(scenario, recording),
        }
        least_s = dict.fromkeys(kinds, float("inf"))
        for _ in range(rounds):
            for kind, work in kinds.items():
                begun_s = time.process_time()
                work()
                least_s[kind] = min(least_s[kind], time.process_time() - begun_s)
    return least_s
