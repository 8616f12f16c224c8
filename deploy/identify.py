"""`tis identify`: the arm's model as a file and as a table."""

from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from common.errors import EXIT_OK, Fault, InputError
from common.runtime.recordings import load_recording
from common.scenario import Scenario
from deploy import run_dir as folder
from patient_side.__main__ import models_for
from patient_side.identification.model_io import dump_models
from patient_side.statespace import ArmModel


def identify_and_print(scenario: Scenario, out_file: Path | None, out: Console, err: Console) -> int:
    """Identify, print and, when asked, write the models; raises `InputError` and `DataError`."""
    if out_file is not None and out_file.suffix != ".json":
        raise InputError(Fault("tis identify", "--out", "must end in .json", str(out_file)))
    recording = load_recording(scenario)
    models = models_for(scenario, recording)
    for text in [*recording.warnings, *(text for model in models for text in model.warnings)]:
        err.print(escape(f"warning: {text}"), style="yellow", soft_wrap=True)
    for model in models:
        out.print(_table(model))
    if out_file is not None:
        folder.write(out_file, dump_models(models))
        out.print(f"written to {out_file}; use it with --set identification.train={out_file}")
    return EXIT_OK


def _table(model: ArmModel) -> Table:
    table = Table(title=f"{model.hand} hand, {model.arm}", title_justify="left", show_header=False)
    table.add_column("")
    table.add_column("")
    kind = "a static relation, order 0" if model.static else f"order {model.order}"
    rows = {
        "method": f"{model.method}, {model.block_rows} block rows, trained on {model.train}",
        "model": f"{kind}, spectral radius {model.spectral_radius:.4f}",
        "fit on validation rows, % x y z": " ".join(f"{value:.3f}" for value in model.fit_pct),
        "static gain": "; ".join(" ".join(f"{value:+.4f}" for value in row) for row in model.space.D),
        "singular values": " ".join(f"{value:.4g}" for value in model.singular_values[:12]),
        "pairing": model.pairing,
        "input forecast": f"damping {model.forecast.damping:.3f}, velocity over "
        f"{model.forecast.velocity_span} samples",
    }
    for name, text in rows.items():
        table.add_row(name, escape(text))
    return table
