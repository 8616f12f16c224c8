"""`tis identify` with method narx: how a polynomial simulates the held-back rows, beside the linear models."""

from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from common.channels import Hand
from common.errors import DataError
from common.scenario.patient import Identification
from common.sources.trajectory import Recording
from patient_side.identification.fit_narx import NarxStudy, fit_narx, n_terms
from patient_side.identification.identify import LOOKS_AHEAD, identify_with_orders
from patient_side.identification.methods import METHODS
from patient_side.identification.validation import fit_text
from patient_side.provenance import without_effect


def compare_with_linear(
    recording: Recording, trainings: Sequence[Recording], identification: Identification, out: Console, err: Console
) -> None:
    """Print one table a hand, all models trained and scored on the same rows; raises `DataError`."""
    studies = [(part.hand, part.arm, fit_narx(trainings, part.hand, identification)) for part in recording.hands]
    said = (*recording.warnings, *recording.anomalies, *without_effect(identification, ()))
    for text in [*said, *((LOOKS_AHEAD,) if identification.looks_ahead else ())]:
        err.print(escape(f"warning: {text}"), style="yellow", soft_wrap=True)
    for hand, arm, study in studies:
        title = f"{hand} hand, {arm}: held-back rows, simulated; error: rms over the movement's deviation"
        table = Table(title=title, title_justify="left")
        for header in ("model", "order", "fit, % x y z", "error"):
            table.add_column(header)
        table.add_row(*_of_narx(study))
        for method in METHODS:
            table.add_row(*_of_linear(trainings, hand, identification, method, recording.pairing))
        out.print(table)
    out.print("narx is for this comparison alone: a run's filters need a linear model", soft_wrap=True)


def _of_narx(study: NarxStudy) -> list[str]:
    lags = study.model.lags
    terms = "/".join(str(n) for n in n_terms(study.model))
    fits = " ".join(fit_text(share, 3) for share in study.fit.fit_pct)
    return ["narx", f"{lags} lag{'s' if lags > 1 else ''}, {terms} terms", fits, f"{study.fit.error:.4g}"]


def _of_linear(
    trainings: Sequence[Recording], hand: Hand, identification: Identification, method: str, pairing: str
) -> list[str]:
    linear = identification.model_copy(update={"method": method, "order": "auto"})
    try:
        found = identify_with_orders(trainings, hand, linear, pairing)
    except DataError as error:
        return [method, "-", escape("; ".join(fault.rule for fault in error.faults)), "-"]
    fits = " ".join(fit_text(share, 3) for share in found.model.fit_pct)
    order = "static" if found.model.static else str(found.model.order)
    left = (sum(1 - share / 100 for share in found.model.fit_pct) / len(found.model.fit_pct)) ** 0.5
    return [method, order, fits, f"{left:.4g}"]
