"""The structures that a model of the arm's own movement may have, and the subspaces that they are found in.

*Integrated*: a model of increments, not of positions about a level.

*Isotropic*: the same movement in every direction. A hand does not know how the axes of a robot's frame are turned; a
model that forecasts alike in every frame is, by Schur's lemma, that of one axis for each of the three, ``A x I`` in
Kronecker's sense, its innovations of any covariance. It has a ninth of the parameters and is found on three times the
rows: of short training rows a free model's forecasts are mostly worse, on rows that it has not seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from patient_side.filters.innovations_filter import AXES
from patient_side.identification.centring_bias import without_centring_bias
from patient_side.identification.noise import floored
from patient_side.identification.stochastic_moesp import (
    StochasticSubspace,
    n_hankel_columns,
    output_factor,
    realise,
    stochastic_subspace,
)
from patient_side.identification.trials import Scaling
from patient_side.statespace import Array, InnovationsModel

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
    """The subspaces of a structure's signals, of the first rows and of all rows, and the unit they are in, m.

    ``shape`` (3, 3) is the covariance of the innovations of an isotropic model but for its size: its trace is 3.
    ``n_rows`` is the mean length of a trial.
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
        sizes, signals, firsts = innovation_sizes(outputs), list(outputs), list(cuts)
        shape = np.mean(
            [_second_moments(y) / size**2 for y, size in zip(outputs, sizes, strict=True)], axis=0
        )  # of each trial alike
        if structure.integrated:
            signals, firsts = [np.diff(y, axis=0) for y in outputs], [cut - 1 for cut in cuts]
        if structure.isotropic:
            signals = [signal[:, [axis]] for signal in signals for axis in range(AXES)]
            sizes, firsts = list(np.repeat(sizes, AXES)), list(np.repeat(firsts, AXES))
        even = [signal / size for signal, size in zip(signals, sizes, strict=True)]
        scale = Scaling.of([(signal, signal) for signal in even]).output
        on_first, found = _subspaces([signal / scale for signal in even], firsts, block_rows)
        # so that the innovations are of the size that they have on average
        unit = scale * float(np.sqrt(np.mean(np.square(sizes))))
        return cls(
            structure, on_first, found, unit, shape * (AXES / np.trace(shape)), sum(map(len, outputs)) / len(outputs)
        )

    def shown(self, orders: Sequence[int]) -> list[int]:
        """Return which of ``orders`` the first rows show, or the largest order that they do."""
        each = AXES if self.structure.isotropic else 1
        largest = each * min(self.on_first.rank, len(self.found.left) - self.found.n_outputs)
        return [n for n in orders if n <= largest] or [max(largest, each)]

    def of_first(self, order: int) -> InnovationsModel:
        """Return the model of ``order`` states of the first rows."""
        return self._model(self.on_first, order)[0]

    def of_all(self, order: int) -> tuple[InnovationsModel, tuple[str, ...]]:
        """Return the model of ``order`` states of all rows, and what was done to make it stable."""
        return self._model(self.found, order)

    def _model(self, subspace: StochasticSubspace, order: int) -> tuple[InnovationsModel, tuple[str, ...]]:
        isotropic = self.structure.isotropic
        form, warnings = realise(subspace, order // AXES if isotropic else order)
        form = form.in_units(self.scale)
        if isotropic and not self.structure.integrated:
            # of one series alone: three that move together have another bias, and increments none that counts
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
    """Return how large each trial's innovations are, but for a common factor: rms of its second differences."""
    sizes = [float(np.sqrt(np.trace(_second_moments(y)))) for y in outputs]
    typical = max(sizes)
    return [size if size > _STILL * typical else typical for size in sizes]


def _second_moments(positions: Array) -> Array:
    """Return the moments (3, 3) of second differences: but for a factor, an isotropic movement's innovations'."""
    accelerations = np.diff(positions, n=2, axis=0)
    return np.asarray(accelerations.T @ accelerations) / len(accelerations)


def _subspaces(
    scaled: Sequence[Array], cuts: Sequence[int], block_rows: int
) -> tuple[StochasticSubspace, StochasticSubspace]:
    """Return the subspaces of the first rows and of all rows; the second factor continues the first."""
    head = [y[:cut] for y, cut in zip(scaled, cuts, strict=True)]
    first = output_factor(head, block_rows)
    on_first = stochastic_subspace(first.copy(), block_rows, n_hankel_columns(head, block_rows))
    # the columns not met yet begin where the last one of the first rows began, plus one
    rest = [y[max(0, cut - 2 * block_rows + 1) :] for y, cut in zip(scaled, cuts, strict=True)]
    factor = output_factor(rest, block_rows, first)
    return on_first, stochastic_subspace(factor, block_rows, n_hankel_columns(scaled, block_rows))
