"""Learned models in `tis identify`: which are trained, the progress of training, and what is said of the result."""

from rich.console import Console
from rich.markup import escape

from common.scenario import Scenario
from common.scenario.estimator_names import LearnedName, is_learned
from patient_side.learned_model import LearnedModel
from patient_side.learning.fit_network import Epoch


def learned_names(scenario: Scenario) -> list[LearnedName]:
    """Return the methods to train: the scenario's method, and its estimators, as far as they are learned."""
    names = (scenario.identification.method, *scenario.estimators)
    return list(dict.fromkeys(name for name in names if is_learned(name)))


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
