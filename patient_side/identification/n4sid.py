"""N4SID (Van Overschee and De Moor 1994, Automatica 30:75): the oblique projection, unweighted.

The future outputs are projected on the past along the future inputs: ``Y_f = H_p W_p + H_f U_f + rest`` by least
squares, and the part ``H_p W_p = Gamma X`` is the extended observability matrix times a sequence of states. MOESP
uses the same ``H_p W_p`` with the future inputs projected out of its rows (a weighting on the right).
"""

from functools import partial

import numpy as np

from tis.patient_side.identification.subspace import FutureBlocks, Subspace, column_space, identify_subspace


def n4sid_subspace(blocks: FutureBlocks) -> Subspace:
    """Return the column space of the oblique projection, in the directions of [U_f; U_p; Y_p]."""
    n_new = blocks.by_past.shape[1]
    # lstsq: without noise the past outputs depend linearly on the rest, and the triangle is singular.
    onto_past = np.linalg.lstsq(blocks.past[:, -n_new:].T, blocks.by_past.T)[0].T
    return column_space(onto_past @ blocks.past, blocks.scale, blocks.n_outputs)


identify = partial(identify_subspace, "n4sid", n4sid_subspace)
"""As `identify_subspace`. Oracles in test_subspace_methods: the projection over all columns by its definition."""
