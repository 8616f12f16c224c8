"""States as the past's prediction of the future, and A and C by least squares on them.

The shift of the extended observability matrix (`subspace`) gives the A of the system where the order is that of the
system. Below it, the matrix's column space is cut off, is no longer invariant under a shift, and its A answers for no
error in the outputs. The regression of the next state and the output on state and input (Van Overschee and De Moor
1996, "Subspace Identification for Linear Systems", 4.4) is the best prediction one sample ahead that so few states of
the past allow. Its price is a bias where the past's window is too short for the state, which does not fade with the
number of rows; the shift has none.
"""

from dataclasses import dataclass

import numpy as np

from tis.patient_side.statespace import Array


@dataclass(frozen=True)
class PastStates:
    """Rows in the directions of a triangular factor (d): predicted futures, and the inputs and outputs of a sample.

    ``now`` (d, s p) is the future of a sample as its past predicts it, without the future inputs' part, and ``after``
    (d, s p) that of the next sample, by the same combination of its own past.
    """

    now: Array
    after: Array
    inputs: Array
    outputs: Array

    @classmethod
    def of(cls, factor: Array, block_rows: int, n_inputs: int, n_outputs: int) -> "PastStates":
        """Return the rows of `triangular_factor`'s result, whose columns are [U_f; U_p; Y_p; Y_f]."""
        m, p = n_inputs, n_outputs
        n_u, n_y = block_rows * m, block_rows * p
        future_u, past_u, past_y, future_y = np.split(factor, [n_u, 2 * n_u, 2 * n_u + n_y], axis=1)
        # The oblique projection: the factor's later rows are free of the future inputs.
        new = slice(n_u, 2 * n_u + n_y)
        by_past = np.linalg.lstsq(factor[new, new], future_y[new])[0]
        later_u = np.hstack([past_u[:, m:], future_u[:, :m]])
        later_y = np.hstack([past_y[:, p:], future_y[:, :p]])
        return cls(
            np.hstack([past_u, past_y]) @ by_past,
            np.hstack([later_u, later_y]) @ by_past,
            future_u[:, :m],
            future_y[:, :p],
        )

    def dynamics(self, observability: Array) -> tuple[Array, Array]:
        """Return A (n, n) and C (p, n) in the coordinates of an orthonormal basis (s p, n) of the outputs."""
        n = observability.shape[1]
        known, answers = self._regression(observability)
        found = np.linalg.lstsq(known, answers)[0].T
        return np.asarray(found[:n, :n]), np.asarray(found[n:, :n])

    def excess(self, A: Array, C: Array, observability: Array) -> float:
        """Return by how much, relatively, A and C miss the next state and the output by more than `dynamics` does."""
        known, answers = self._regression(observability)
        n = len(A)
        least = answers - known @ np.linalg.lstsq(known, answers)[0]
        rest = answers - known[:, :n] @ np.vstack([A, C]).T
        rest = rest - known[:, n:] @ np.linalg.lstsq(known[:, n:], rest)[0]
        own, other = least.T @ least, rest.T @ rest
        floor = 1e-12 * np.trace(other) * np.eye(len(own))
        return float(np.trace(np.linalg.solve(own + floor, other + floor)) / len(own)) - 1.0

    def _regression(self, observability: Array) -> tuple[Array, Array]:
        known = np.hstack([self.now @ observability, self.inputs])
        return known, np.hstack([self.after @ observability, self.outputs])
