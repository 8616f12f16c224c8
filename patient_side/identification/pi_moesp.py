"""Past-input MOESP (Verhaegen 1993, Int. J. Control 58:555): past inputs alone as instruments.

Past outputs carry the noise, and where that is coloured they are correlated with the future noise: `moesp` and
`n4sid` then settle on wrong poles however long the data. Past inputs are not, as long as nothing feeds outputs back
to inputs. The price is variance: what noise alone excites is not seen.
"""

from functools import partial

from patient_side.identification.subspace import FutureBlocks, Subspace, column_space, identify_subspace


def pi_moesp_subspace(blocks: FutureBlocks) -> Subspace:
    """Return the column space of what past inputs explain beyond the future ones."""
    return column_space(blocks.by_past_inputs, blocks.scale, blocks.n_outputs)


identify = partial(identify_subspace, "pi_moesp", pi_moesp_subspace)
"""As `identify_subspace`; an order above s m is refused. Oracle in test_subspace_methods: coloured noise."""
