"""Command `tis identify`: the arm's model as a file, as a table and as a figure."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.markup import escape

from tis.common.channels import Hand
from tis.common.errors import EXIT_OK, DataError, Fault, InputError
from tis.common.estimators import short_name
from tis.common.extras import GET_REPORT
from tis.common.runtime.recordings import load_recording, load_training
from tis.common.scenario import Scenario
from tis.common.scenario.estimator_names import LearnedName, is_learned
from tis.common.scenario.identification import Identification, is_model_file
from tis.common.sources.provenance import in_words
from tis.common.sources.trajectory import Recording
from tis.deploy.present.numbers import NONE
from tis.deploy.present.table import Column, Table
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import check_outputs, print_warnings, unwritable
from tis.patient_side.estimators.simple import dc_gain
from tis.patient_side.identification.identify import LOOKS_AHEAD, Identified, identify_hands, identify_with_orders
from tis.patient_side.identification.model_file import dump_models
from tis.patient_side.identification.narx import NarxStudy, fit_narx, n_terms
from tis.patient_side.identification.order import OrderChoice
from tis.patient_side.identification.subspace_methods import METHODS
from tis.patient_side.identification.validation import fit_text
from tis.patient_side.learned_model import LearnedModel
from tis.patient_side.learning.fit_network import Epoch
from tis.patient_side.learning.train import check_extra, with_learned
from tis.patient_side.models import models_for
from tis.patient_side.provenance import warnings_at_start, without_effect
from tis.patient_side.statespace import ArmModel, order_text

# NARX study of `tis identify`: a polynomial model beside the linear ones, simulated on the held-back rows.


def compare_with_linear(
    recording: Recording, trainings: Sequence[Recording], identification: Identification, out: Console, err: Console
) -> None:
    """Print one table per hand, with all models trained and scored on the same rows; raises `DataError`."""
    studies = [(part.hand, part.arm, fit_narx(trainings, part.hand, identification)) for part in recording.hands]
    print_warnings(err, *recording.warnings, *recording.anomalies, *without_effect(identification, ()))
    if identification.looks_ahead:
        print_warnings(err, LOOKS_AHEAD)
    for hand, arm, study in studies:
        title = f"{hand} hand, {arm}: held-back rows, simulated; error: rms over the movement's deviation"
        linear = [_linear_row(trainings, hand, identification, method, recording.pairing) for method in METHODS]
        columns = [Column(head, words=True, wraps=True) for head in ("model", "order", "fit, % x y z", "error")]
        out.print(Table(title, columns, [_narx_row(study), *linear]).terminal())
    out.print("narx serves this comparison only: the filters of a run need a linear model", soft_wrap=True)


def _narx_row(study: NarxStudy) -> list[str]:
    lags = study.model.lags
    terms = "/".join(str(n) for n in n_terms(study.model))
    fits = " ".join(fit_text(share, 3) for share in study.fit.fit_pct)
    return ["narx", f"{lags} lag{'s' if lags > 1 else ''}, {terms} terms", fits, f"{study.fit.error:.4g}"]


def _linear_row(
    trainings: Sequence[Recording], hand: Hand, identification: Identification, method: str, pairing: str
) -> list[str]:
    linear = identification.model_copy(update={"method": method, "order": "auto"})
    try:
        found = identify_with_orders(trainings, hand, linear, pairing)
    except DataError as error:
        return [method, NONE, "; ".join(fault.rule for fault in error.faults), NONE]
    fits = " ".join(fit_text(share, 3) for share in found.model.fit_pct)
    order = "static" if found.model.static else str(found.model.order)
    residual = (sum(1 - share / 100 for share in found.model.fit_pct) / len(found.model.fit_pct)) ** 0.5
    return [method, order, fits, f"{residual:.4g}"]


# Learned models in `tis identify`: which are trained, the progress of training, and what is said of the result.


def learned_names(scenario: Scenario) -> list[LearnedName]:
    """Return the methods to train: the scenario's method, and its estimators, as far as they are learned."""
    names = (scenario.identification.method, *scenario.estimators)
    return list(dict.fromkeys(short_name(name) for name in names if is_learned(name)))


def print_epoch(epoch: Epoch, err: Console) -> None:
    """Print the state of training after an epoch."""
    stage = "all examples" if epoch.error is None else "without those held out"
    judged = "" if epoch.error is None else f", on those held out {epoch.error:.3f}"
    text = (
        f"{epoch.method}, {stage}: epoch {epoch.number} of {epoch.n_epochs}, {epoch.learned:.3f} of the linear "
        f"forecast's error on those learned{judged}"
    )
    err.print(escape(text), style="dim", soft_wrap=True)


def learned_text(model: LearnedModel) -> str:
    """Return size, training and held-out error of a model, in words."""
    about = model.training
    n_weights = sum(weight.size for weight in model.weights.values())
    on = ", ".join(about.held_out) if about.held_out else "its own training rows"
    epochs = "1 epoch" if about.n_epochs == 1 else f"{about.n_epochs} epochs"
    best = f"{about.errors.min():.3f}" if len(about.errors) else "unknown"
    return (
        f"{n_weights:,} weights, {epochs} of {about.n_rows:,} examples, seed {about.seed}; error {best} of the "
        f"linear forecast's on {on}"
    )


_FIGURE_SUFFIXES: Final = (".svg", ".pdf", ".png")


def identify_and_print(
    scenario: Scenario, out_file: Path | None, figure_file: Path | None, out: Console, err: Console
) -> int:
    """Identify and print the models; write model file and figure if requested. Raises `InputError`, `DataError`."""
    train = scenario.identification.train
    from_file = is_model_file(train)
    _check_options(scenario, out_file, figure_file, train if from_file else None)
    recording = load_recording(
        scenario.model_copy(update={"duration_s": 1.0 / scenario.rate_hz})
    )  # provenance only: nothing is run
    found: list[Identified] = []
    if from_file:
        models = models_for(scenario, recording)
    else:
        trainings = load_training(scenario, recording)
        if scenario.identification.method == "narx":
            compare_with_linear(recording, trainings, scenario.identification, out, err)
            return EXIT_OK
        wanted: tuple[str, ...] | None = () if out_file is None else None  # a file must serve every estimator
        hands = [hand.hand for hand in recording.hands]
        learned = learned_names(scenario)
        check_extra(learned)
        found = list(identify_hands(trainings, hands, scenario.identification, recording.pairing, wanted))
        _print_rows(trainings, scenario, out)
        identified = [each.model for each in found]
        models = with_learned(
            identified, trainings, scenario.identification, learned, progress=lambda epoch: print_epoch(epoch, err)
        )
    ahead = not from_file and scenario.identification.looks_ahead
    print_warnings(err, *warnings_at_start(scenario, recording, models), *_plant_unused(scenario))
    for i, model in enumerate(models):
        out.print(_table(model, found[i].orders if found else None, ahead).terminal())
    if out_file is not None:
        folder.write(out_file, dump_models(models))
        out.print(
            f"written to {out_file}; use it with --set identification.train={out_file} {_start_hint(scenario)}",
            soft_wrap=True,
        )
    if figure_file is not None:
        folder.write(figure_file, _figure(found, figure_file.suffix[1:]))
        out.print(f"figure written to {figure_file}")
    return EXIT_OK


def _print_rows(trainings: Sequence[Recording], scenario: Scenario, out: Console) -> None:
    """Print how long the training rows are taken to be: a file of recordings holds no times."""
    if scenario.source.kind == "synthetic":
        return
    n_rows = sum(len(recording) for recording in trainings)
    rate_hz = trainings[0].rate_hz
    of = f"{trainings[0].label}" if len(trainings) == 1 else f"{len(trainings)} trials"
    out.print(escape(f"{of}: {n_rows} rows, taken at {rate_hz} Hz, are {n_rows / rate_hz:.1f} s"), soft_wrap=True)


def _start_hint(scenario: Scenario) -> str:
    """Return a hint at the first row of a run that uses the model file."""
    if scenario.identification.train != "own_head":
        return "(a run then begins at row 0 of the source; source.start changes that)"
    n_rows = scenario.identification.train_samples
    return (
        "(a run then begins at row 0 of the source: for a fair test, play another recording, or this one after its "
        f"training rows with source.start={n_rows})"
    )


def _plant_unused(scenario: Scenario) -> list[str]:
    plant = scenario.patient.plant.kind
    if plant == "replay":
        return []
    return [f"patient.plant has no effect here: the model describes the recorded arm, not the {plant}"]


def _check_options(
    scenario: Scenario, out_file: Path | None, figure_file: Path | None, model_file: str | None
) -> None:
    """Raise `InputError` or `DataError` with all faults of the options, before any computation."""
    identification, learned = scenario.identification, learned_names(scenario)
    faults = [] if out_file is None else _out_faults(identification, out_file, model_file, bool(learned))
    if out_file is None and model_file is None and learned:
        rule = f"is needed, as training {' and '.join(learned)} takes minutes: a file that ends in .safetensors"
        faults.append(Fault("tis identify", "--out", rule))
    faults += [] if figure_file is None else _figure_faults(figure_file, model_file)
    if model_file is None and identification.method == "narx":
        given = [(option, file) for option, file in (("--out", out_file), ("--figure", figure_file)) if file]
        rule = "requires a linear model, and narx is not linear"
        faults += [Fault("tis identify", option, rule, str(file)) for option, file in given]
    if faults:
        raise InputError([*faults, *unwritable(out_file, figure_file)])
    check_outputs(out_file, figure_file)


def _out_faults(
    identification: Identification, out_file: Path, model_file: str | None, has_weights: bool
) -> list[Fault]:
    faults = []
    suffix = ".safetensors" if has_weights else ".json"
    if model_file is not None:
        suffix = Path(model_file).suffix
    if out_file.suffix != suffix:
        why = ", as learned models have weights" if suffix == ".safetensors" else ""
        faults.append(Fault("tis identify", "--out", f"must end in {suffix}{why}", str(out_file)))
    if model_file is None and identification.looks_ahead:
        rule = "holds models for runs, whose filters get no velocity: identification.inputs must be position"
        faults.append(Fault("tis identify", "--out", rule, str(out_file)))
    return faults


def _figure_faults(figure_file: Path, model_file: str | None) -> list[Fault]:
    faults = []
    if figure_file.suffix not in _FIGURE_SUFFIXES:
        rule = f"must end in {', '.join(_FIGURE_SUFFIXES[:-1])} or {_FIGURE_SUFFIXES[-1]}"
        faults.append(Fault("tis identify", "--figure", rule, str(figure_file)))
    if model_file is not None:
        rule = "requires training rows: identification.train must not be a model file"
        faults.append(Fault("tis identify", "--figure", rule, model_file))
    try:
        import matplotlib  # noqa: F401  availability check
    except ImportError:
        faults.append(Fault("tis identify", "--figure", f"requires matplotlib, which is missing: {GET_REPORT}"))
    return faults


def _figure(found: Sequence[Identified], file_format: str) -> bytes:
    from tis.deploy.report.publication.matplotlib_figures import identification_figure, rendered  # loads matplotlib

    return rendered(identification_figure(found), file_format)


def _order_by_rule(orders: OrderChoice) -> list[tuple[str, int | str]]:
    return [
        ("85 % energy", "none" if orders.energy is None else orders.energy),
        ("largest log-gap", "none" if orders.log_gap is None else orders.log_gap),
        ("information criterion", orders.criterion),
        ("validation", orders.validation),
    ]


def _table(model: ArmModel, orders: OrderChoice | None, looks_ahead: bool) -> Table:
    kind = "a static relation, order 0" if model.static else f"order {order_text(model)}"
    counted = "order" if model.n_lags is None else "lags"
    rows = {
        "method": f"{model.method}, {model.block_rows} block rows",
        "trained on": f"{model.train}: {in_words(model.trained_on)}",
        "inputs": "position and velocity: looks ahead" if looks_ahead else "position",
        "model": f"{kind}, spectral radius {model.spectral_radius:.4f}",
        "fit on validation rows, % x y z": " ".join(fit_text(value, 3) for value in model.fit_pct),
        "gain at rest": "; ".join(" ".join(f"{value:+.4f}" for value in row) for row in dc_gain(model.space)),
        "singular values": " ".join(f"{value:.4g}" for value in model.singular_values[:12]) or "none",
        f"{counted} by each rule": "unknown: the model comes from a file"
        if orders is None
        else ", ".join(f"{rule} {value}" for rule, value in _order_by_rule(orders)),
        "pairing": model.pairing,
        "input forecast": f"damping {model.forecast.damping:.3f}, persistence {model.forecast.persistence:.3f}, "
        f"velocity over {model.forecast.velocity_span} samples",
    }
    rows |= {learned.method: learned_text(learned) for learned in model.learned}
    return Table(f"{model.hand} hand, {model.arm}", [Column("", words=True, wraps=True)] * 2, list(rows.items()))
