"""The linear identification methods by the names that scenarios use."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from tis.patient_side.identification import arx, cva, moesp, n4sid, pi_moesp
from tis.patient_side.identification.linear_model import LinearModel
from tis.patient_side.identification.signals import Signals
from tis.patient_side.identification.subspace import Method

SUBSPACE_METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "moesp": moesp.moesp_subspace,
        "pi_moesp": pi_moesp.pi_moesp_subspace,
        "n4sid": n4sid.n4sid_subspace,
        "cva": cva.cva_subspace,
    }
)

METHODS: Mapping[str, Callable[[Signals, Signals, int, int], LinearModel]] = MappingProxyType(
    {
        "moesp": moesp.identify,
        "pi_moesp": pi_moesp.identify,
        "n4sid": n4sid.identify,
        "cva": cva.identify,
        "arx": arx.identify,
    }
)
"""Each takes ``(u, y, order, horizon)``: see `identify_subspace`."""
