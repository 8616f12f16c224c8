"""The structures of a model of the arm's own movement, and the subspaces of each structure.

*Integrated*: a model of increments, not of positions about a level.

*Isotropic*: the same movement in every direction. A hand is independent of the orientation of a robot's frame; by
Schur's lemma, a model with the same forecasts in every frame is the model of one axis for each of the three, the
Kronecker product ``A x I``, with innovations of any covariance. It has a ninth of the parameters and three times the
rows: with short training data a free model mostly forecasts new rows worse.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import eig

from tis.patient_side.filters.innovations_filter import AXES
from tis.patient_side.identification.noise import floored
from tis.patient_side.identification.stochastic_moesp import (
    InnovationsForm,
    StochasticSubspace,
    n_hankel_columns,
    output_factor,
    realise,
    stochastic_subspace,
)
from tis.patient_side.identification.trials import Scaling
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import InnovationsModel

# Correction of the bias from centring: a movement about its own mean seems to return to it too fast.
#
# On a series about its own mean, least squares underestimate an autoregressive coefficient r by (1 + 3 r) / T over T
# rows (Kendall 1954, "Note on bias in the estimation of autocorrelation", Biometrika 41:403; Marriott and Pope, ibid.
# 390). A random walk then looks like a movement that returns within a quarter of the trial, and so do forecasts over
# some seconds. The correction applies only where it matters: to a decay so slow that a test does not reject a random
# walk.

_UNIT_ROOT_5_PCT = 14.1
"""T (1 - r) above which a Dickey-Fuller test about a mean rejects a random walk, at 5 % (Fuller 1976, 8.5.1)."""

_MAX_DECAY = 10.0
"""Longest decay, in lengths of a trial: the rows carry no information on longer ones."""

_DEFECTIVE = 1e-6


def without_centring_bias(form: InnovationsForm, n_rows: float) -> InnovationsForm:
    """Return the model with its slowest decay corrected; other eigenvalues, gain and innovations are unchanged.

    ``n_rows`` is the length of a trial about its mean. The model is unchanged where the largest eigenvalue is not
    real and positive, where a random walk is rejected, and where the filter with the corrected A would be unstable.
    Oracle: forecasts of random walks, test_centring_bias.
    """
    A = corrected(form.A, n_rows)
    stable = not len(A) or float(np.max(np.abs(np.linalg.eigvals(A - form.K @ form.C)))) < 1.0
    return replace(form, A=A) if stable else form


def corrected(A: Array, n_rows: float) -> Array:
    """Return A with its slowest decay corrected where needed. Oracle: least squares on simulated random walks."""
    if not len(A):
        return A
    found: tuple[Array, Array, Array] = eig(A, left=True, right=True)  # type: ignore[assignment]
    values, left, right = found
    slowest = int(np.argmax(np.abs(values)))
    r = float(values[slowest].real)
    if values[slowest].imag != 0 or r <= 0 or n_rows * (1.0 - r) > _UNIT_ROOT_5_PCT:
        return A
    v, w = right[:, slowest].real, left[:, slowest].real
    product = float(w @ v)
    if abs(product) < _DEFECTIVE:
        return A
    # Move this eigenvalue alone: a rank-one change along its right and left eigenvectors.
    slower = max(r, min(r + (1.0 + 3.0 * r) / n_rows, 1.0 - 1.0 / (_MAX_DECAY * n_rows)))
    return np.asarray(A + (slower - r) * np.outer(v, w) / product)


_FIRST_LEVEL_STEP = 0.1
_STILL = 1e-3


class Structure(NamedTuple):
    """A structure; see the module."""

    isotropic: bool
    integrated: bool


PREFERRED: Final = (Structure(True, False), Structure(True, True), Structure(False, False), Structure(False, True))
"""The simplest first: an arm has a bounded space to move in, and a hand no axes."""


@dataclass(frozen=True)
class StructuredSubspace:
    """The subspaces of a structure's signals, of the first rows and of all rows, and their units in m.

    ``shape`` (3, 3) is the covariance of an isotropic model's innovations, normalised to the trace 3. ``n_rows`` is
    the mean length of a trial.
    """

    structure: Structure
    on_first: StochasticSubspace
    found: StochasticSubspace
    scale: Array
    shape: Array
    n_rows: float

    @classmethod
    def of(
        cls, structure: Structure, outputs: Sequence[Array], cuts: Sequence[int], block_rows: int
    ) -> "StructuredSubspace":
        """Return the subspaces of positions (N_i, 3) in m; the first rows end at ``cuts``."""
        # Trials are weighted by the inverse size of their innovations.
        sizes, signals, firsts = innovation_sizes(outputs), list(outputs), list(cuts)
        shape = np.mean([_second_moments(y) / size**2 for y, size in zip(outputs, sizes, strict=True)], axis=0)
        if structure.integrated:
            signals, firsts = [np.diff(y, axis=0) for y in outputs], [cut - 1 for cut in cuts]
        if structure.isotropic:
            signals = [signal[:, [axis]] for signal in signals for axis in range(AXES)]
            sizes, firsts = list(np.repeat(sizes, AXES)), list(np.repeat(firsts, AXES))
        even = [signal / size for signal, size in zip(signals, sizes, strict=True)]
        scale = Scaling.of([(signal, signal) for signal in even]).output
        on_first, found = _subspaces([signal / scale for signal in even], firsts, block_rows)
        # The unit restores the average size of the innovations.
        unit = scale * float(np.sqrt(np.mean(np.square(sizes))))
        return cls(
            structure, on_first, found, unit, shape * (AXES / np.trace(shape)), sum(map(len, outputs)) / len(outputs)
        )

    def shown(self, orders: Sequence[int]) -> list[int]:
        """Return those of ``orders`` that the first rows show, or else the largest order that they show."""
        each = AXES if self.structure.isotropic else 1
        largest = each * min(self.on_first.rank, len(self.found.left) - self.found.n_outputs)
        return [n for n in orders if n <= largest] or [max(largest, each)]

    def of_first(self, order: int) -> InnovationsModel:
        """Return the model of ``order`` states of the first rows."""
        return self._model(self.on_first, order)[0]

    def of_all(self, order: int) -> tuple[InnovationsModel, tuple[str, ...]]:
        """Return the model of ``order`` states of all rows, and a warning if it was unstable."""
        return self._model(self.found, order)

    def _model(self, subspace: StochasticSubspace, order: int) -> tuple[InnovationsModel, tuple[str, ...]]:
        isotropic = self.structure.isotropic
        form, warnings = realise(subspace, order // AXES if isotropic else order)
        form = form.in_units(self.scale)
        if isotropic and not self.structure.integrated:
            # The bias formula is that of a single series; three coupled ones have another bias, increments none.
            form = without_centring_bias(form, self.n_rows)
        directions = np.eye(AXES if isotropic else 1)
        model = InnovationsModel(
            A=np.asarray(np.kron(form.A, directions), dtype=float),
            C=np.asarray(np.kron(form.C, directions), dtype=float),
            K=np.asarray(np.kron(form.K, directions), dtype=float),
            Re=floored(form.Re * self.shape if isotropic else form.Re),
            level_step=_FIRST_LEVEL_STEP,
            block_rows=len(self.found.left) // self.found.n_outputs,
            singular_values=self.found.singular_values,
            scale_horizons=np.ones(1),
            covariance_scale=np.ones(1),
            integrated=self.structure.integrated,
            isotropic=isotropic,
        )
        return model, warnings


def innovation_sizes(outputs: Sequence[Array]) -> list[float]:
    """Return the size of each trial's innovations up to a common factor: the rms of its second differences."""
    sizes = [float(np.sqrt(np.trace(_second_moments(y)))) for y in outputs]
    typical = max(sizes)
    return [size if size > _STILL * typical else typical for size in sizes]


def _second_moments(positions: Array) -> Array:
    """Return the moments (3, 3) of second differences: an isotropic movement's innovations' up to a factor."""
    accelerations = np.diff(positions, n=2, axis=0)
    return np.asarray(accelerations.T @ accelerations) / len(accelerations)


def _subspaces(
    scaled: Sequence[Array], cuts: Sequence[int], block_rows: int
) -> tuple[StochasticSubspace, StochasticSubspace]:
    """Return the subspaces of the first rows and of all rows; the second factor continues the first."""
    head = [y[:cut] for y, cut in zip(scaled, cuts, strict=True)]
    first = output_factor(head, block_rows)
    on_first = stochastic_subspace(first.copy(), block_rows, n_hankel_columns(head, block_rows))
    # The remaining columns begin one row after the last column of the first rows.
    rest = [y[max(0, cut - 2 * block_rows + 1) :] for y, cut in zip(scaled, cuts, strict=True)]
    factor = output_factor(rest, block_rows, first)
    return on_first, stochastic_subspace(factor, block_rows, n_hankel_columns(scaled, block_rows))
