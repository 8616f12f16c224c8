"""The common result of all identification methods, in metres about the operating point of the training set."""

from dataclasses import dataclass

from tis.patient_side.identification.order import OrderChoice
from tis.patient_side.identification.validation import SimulationFit
from tis.patient_side.statespace import Array, NoiseModel, StateSpace


@dataclass(frozen=True)
class Fitted:
    """A model of all training rows, and the results of the order selection.

    ``x0`` (n,) is the state at the first training row. ``singular_values`` are those of all rows, ``orders`` the
    orders by the rules. ``first_rows`` is the model of the same order fitted before the validation rows, ``fit`` its
    simulation of these, started from their first ``n_start`` rows.
    """

    space: StateSpace
    x0: Array
    noise: NoiseModel
    singular_values: Array
    orders: OrderChoice
    first_rows: StateSpace
    fit: SimulationFit
    n_start: int
    static: bool
    warnings: tuple[str, ...]
