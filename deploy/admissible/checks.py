"""Independent check of a region: places drawn inside and outside of it, judged on fresh seeds."""

from typing import Final, NamedTuple

from common.streams import Stream
from deploy.admissible.rays import Place
from deploy.admissible.region import Region

_MOST_DRAWN: Final = 20_000
_SEED: Final = 1
MAX_OPTIMISTIC: Final = 0.1
MAX_OVERLOOKED: Final = 0.25


class Drawn(NamedTuple):
    """Places inside and outside of a region; fewer than requested where the region or its complement is small."""

    inside: list[Place]
    outside: list[Place]


class Check(NamedTuple):
    """Counts of drawn places, and of those whose verdict on fresh seeds disagrees with the region.

    ``optimistic``: outside, though the region holds them; ``overlooked``: inside, though it does not.
    """

    n_inside: int
    optimistic: int
    n_outside: int
    overlooked: int

    @property
    def text(self) -> str:
        """Warning if too many disagree; empty otherwise."""
        grid = "see a grid of the box by tis compare with --sweep ranges"
        if self.optimistic > MAX_OPTIMISTIC * self.n_inside:
            found = f"{self.optimistic} of {self.n_inside} places inside are not admissible on fresh seeds"
            return f"{found}: take more --seeds, or {grid}"
        if self.overlooked > MAX_OVERLOOKED * self.n_outside:
            found = f"{self.overlooked} of {self.n_outside} places outside are admissible"
            return f"{found}: take more --seeds, or the region has parts that no straight line reaches: {grid}"
        return ""


def drawn(region: Region, n_places: int, n_axes: int) -> Drawn:
    """Return up to half of ``n_places`` inside and half outside, drawn uniformly; always the same for a region."""
    uniforms = Stream.named(_SEED, "admissible/checks").uniforms(0, _MOST_DRAWN * n_axes)
    found = Drawn([], [])
    for i in range(_MOST_DRAWN):
        place = tuple(uniforms[i * n_axes : (i + 1) * n_axes].tolist())
        half = found.inside if region.contains(place) else found.outside
        if len(half) < (n_places + 1) // 2:
            half.append(place)
        elif len(found.inside) + len(found.outside) >= 2 * ((n_places + 1) // 2):
            break
    return found
