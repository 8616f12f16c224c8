"""Past-input MOESP (Verhaegen 1993, Int. J. Control 58:555): past inputs alone as instruments.

Past outputs contain noise, and where that is coloured they are correlated with the future noise: `moesp` and
`n4sid` then converge to wrong poles however long the data. Past inputs are uncorrelated with it, as long as there is
no feedback from outputs to inputs. The price is variance: modes that only noise excites are invisible.
"""

from dataclasses import replace
from functools import partial

from tis.patient_side.identification.subspace import FutureBlocks, Subspace, column_space, identify_subspace


def pi_moesp_subspace(blocks: FutureBlocks) -> Subspace:
    """Return the column space of the part that past inputs explain beyond the future ones."""
    found = column_space(blocks.by_past_inputs, blocks.scale, blocks.n_outputs)
    return replace(found, uses_outputs=False)


identify = partial(identify_subspace, "pi_moesp", pi_moesp_subspace)
"""As `identify_subspace`; an order above s m is rejected. Oracle in test_subspace_methods: coloured noise."""
