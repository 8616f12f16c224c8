"""Past-output MOESP (Verhaegen 1994, Automatica 30:61): past inputs and outputs as instruments.

The block L32 of the factor, the part of the future outputs that the past explains beyond the future inputs, has
the column space of the extended observability matrix; it is consistent under white process and measurement noise.
"""

from functools import partial

from tis.patient_side.identification.subspace import FutureBlocks, Subspace, column_space, identify_subspace


def moesp_subspace(blocks: FutureBlocks) -> Subspace:
    """Return the column space of L32, with no weighting on the outputs."""
    return column_space(blocks.by_past, blocks.scale, blocks.n_outputs)


identify = partial(identify_subspace, "moesp", moesp_subspace)
"""As `identify_subspace`. Oracles in test_moesp: a known system's Markov parameters, SLICOT's published example."""
