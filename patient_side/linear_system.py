"""A linear system and its noise as values: x[k+1] = A x[k] + B u[k] + w, y[k] = C x[k] + D u[k] + v.

They load numpy alone, so that identification works without the testbed; only a reader of model files needs pydantic.
"""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STORED: Final = {"strict": True, "extra": "forbid"}
"""How pydantic reads a dataclass of a model file: values of the declared types, and no other keys."""


class _StoredMatrix:
    """How a model file holds a matrix; asked by pydantic alone."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from tis.patient_side.model_fields import Numbers, lists

        stored: Any = lists(list[Numbers])
        return stored.__get_pydantic_core_schema__(source, handler)


Matrix = Annotated[Array, _StoredMatrix()]

_BLOCK = 32


@dataclass(frozen=True)
class StateSpace:
    """Matrices of shapes A (n, n), B (n, m), C (p, n), D (p, m); n may be 0: a static relation y = D u."""

    __pydantic_config__: ClassVar = STORED

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix

    @property
    def order(self) -> int:
        """Number of states n."""
        return len(self.A)

    @property
    def n_inputs(self) -> int:
        """Number of inputs m."""
        return int(self.D.shape[1])

    @property
    def n_outputs(self) -> int:
        """Number of outputs p."""
        return len(self.D)

    def spectral_radius(self) -> float:
        """Return the largest modulus of A's eigenvalues, 0 for a static relation."""
        return float(np.max(np.abs(np.linalg.eigvals(self.A)))) if self.order else 0.0

    def simulate(self, u: Array, x0: Array | None = None) -> Array:
        """Return the noise-free outputs (N, p) for inputs (N, m) from state ``x0`` (n,), zero by default.

        Oracle: a plain loop, test_statespace.
        """
        # Blocks of rows instead of a loop over rows: within a block the outputs are products of matrices.
        n, p, m, length = self.order, self.n_outputs, self.n_inputs, min(_BLOCK, max(1, len(u)))
        n_blocks = -(-len(u) // length)
        inputs = np.zeros((n_blocks, length * m))
        inputs.reshape(-1)[: len(u) * m] = u.reshape(-1)
        # C A^t, and the Markov parameters D, C B, C A B, ...
        powers = np.empty((length + 1, n, n))
        powers[0] = np.eye(n)
        for t in range(length):
            powers[t + 1] = self.A @ powers[t]
        observe = self.C @ powers[:length]
        markov = np.concatenate([np.zeros((length - 1, p, m)), self.D[None], (observe @ self.B)[:-1]])
        # Response to the inputs of the same block: response[t, :, j] is that of its row t to its row j.
        response = np.lib.stride_tricks.sliding_window_view(markov, length, axis=0)[:, :, :, ::-1]
        outputs = inputs @ response.transpose(3, 2, 0, 1).reshape(length * m, length * p)
        # Response to the state at the beginning of each block, which runs from block to block.
        if n:
            drives = inputs @ (powers[length - 1 :: -1] @ self.B).transpose(0, 2, 1).reshape(length * m, n)
            states = np.empty((n_blocks, n))
            x = np.zeros(n) if x0 is None else np.asarray(x0, dtype=float)
            for block, drive in enumerate(drives):
                states[block] = x
                x = powers[length] @ x + drive
            outputs += states @ observe.reshape(length * p, n).T
        return np.asarray(outputs.reshape(n_blocks * length, p)[: len(u)])


@dataclass(frozen=True)
class NoiseModel:
    """Covariances of process noise Q (n, n), measurement noise R (p, p) and their cross term S (n, p), SI units."""

    __pydantic_config__: ClassVar = STORED

    Q: Matrix
    R: Matrix
    S: Matrix

    @property
    def gain(self) -> Array:
        """Return the Kalman gain K (n, p) of an innovations form: ``w = K v``, so ``S = K R`` and ``Q = K R K'``."""
        return np.asarray(np.linalg.solve(self.R, self.S.T).T)
