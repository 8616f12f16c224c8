"""Canonical variate analysis (Larimore 1990): directions of the future ranked by their predictability.

The column space of `moesp` with whitened future outputs: the singular values are the canonical correlations of past
and future given the future inputs, 0..1, so that a direction ranks by its predictable share and not by its size. Of
the subspace weightings it has the least variance for white inputs and noise.
"""

from functools import partial

import numpy as np

from tis.patient_side.identification.subspace import FutureBlocks, Subspace, column_space, identify_subspace

_RELATIVE_FLOOR = 1e-8


def cva_subspace(blocks: FutureBlocks) -> Subspace:
    """Return the directions by canonical correlation, carried back to the outputs and made orthonormal again.

    Directions of the outputs, given the future inputs, below 1e-8 of the largest are not amplified by the whitening.
    """
    given_inputs = np.hstack([blocks.by_past, blocks.unexplained])
    directions, sizes, _ = np.linalg.svd(given_inputs, full_matrices=False)
    sizes = np.maximum(sizes, _RELATIVE_FLOOR * blocks.scale)
    whitened = column_space((directions.T @ blocks.by_past) / sizes[:, None], 1.0, blocks.n_outputs)
    back, _ = np.linalg.qr(directions @ (sizes[:, None] * whitened.left))
    return Subspace(back, whitened.singular_values, whitened.rank, blocks.n_outputs)


identify = partial(identify_subspace, "cva", cva_subspace)
"""As `identify_subspace`. Oracle in test_subspace_methods: canonical correlations by their definition."""
