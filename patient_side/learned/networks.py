"""The networks by name: encoder, shapes of all weights, and how they read what is lost."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from tis.patient_side.learned import cnn, gaussian_head, informer, transformer
from tis.patient_side.learned.layers import Array, Arrays, Shapes


@dataclass(frozen=True)
class Network:
    """``encode(xp, weights, steps, context)`` returns a path's summary; ``zero_lost``: missing samples read as 0."""

    encode: Callable[[Any, Arrays, Array, Array], Array]
    shapes: Shapes
    zero_lost: bool = False

    def __call__(
        self, xp: Any, weights: Arrays, steps: Array, context: Array, ages: Array, moves: Array
    ) -> tuple[Array, Array]:
        """Return means and logarithms of deviations: see `gaussian_head.distribution`."""
        return gaussian_head.distribution(xp, weights, self.encode(xp, weights, steps, context), ages, moves)


NETWORKS: Final[Mapping[str, Network]] = MappingProxyType(
    {
        "transformer": Network(transformer.encode, transformer.shapes() | gaussian_head.shapes(transformer.WIDTH)),
        "informer": Network(
            informer.encode, informer.shapes() | gaussian_head.shapes(transformer.WIDTH), zero_lost=True
        ),
        "cnn": Network(cnn.encode, cnn.shapes() | gaussian_head.shapes(cnn.WIDTH)),
    }
)
