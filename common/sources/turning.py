"""Turning of a hand: each reach also turns it, about a random axis, by an angle that grows with the reach's length.

The constants were fitted to the aggregate statistics of recorded suturing that `common.sources.calibration` holds.
"""

from typing import Final

import numpy as np
import scipy

from common.scenario.source import SyntheticSource
from common.sources.minimum_jerk import Movements
from common.sources.reaching import Timing, about_the_centre, directions
from common.sources.trajectory import Array
from common.sources.wander import Band, wander
from common.streams import Stream

USUAL_TURN_DEG: Final = 19.0
_ANGLE_SPREAD: Final = 1.1  # standard deviation of the logarithm
_WITH_LENGTH: Final = 0.9  # correlation of the logarithms of angle and length
_DURATION_SHARE: Final = 0.9  # of the reach's; the turn is in its middle
_HALF_SPACE_RAD: Final = 0.7
_TREMOR_RAD: Final = 0.0011  # per axis, where movements turn by the usual angle
_TREMOR_HZ: Final[Band] = (3.5, 12.0)


def turning(source: SyntheticSource, timing: Timing, draws: Stream) -> Movements:
    """Return rotation vectors in rad: a turn for each reach of ``timing``, of median angle ``turn_deg``.

    Angles are lognormal, axes isotropic. The hand stays near its middle orientation, as it stays near the centre of
    its place. Oracle: the statistics of recorded suturing.
    """
    n_movements = len(timing.onset_s)
    drawn = draws.uniforms(0, 4 * n_movements).reshape(n_movements, 4)
    own = np.sqrt(1.0 - _WITH_LENGTH**2) * scipy.special.ndtri(drawn[:, 3])
    median_rad = np.radians(source.turn_deg)
    angle_rad = median_rad * np.exp(_ANGLE_SPREAD * (_WITH_LENGTH * timing.length_score + own))
    half_space_rad = max(_HALF_SPACE_RAD, 1.5 * median_rad)
    steps_rad = angle_rad[:, np.newaxis] * directions(drawn)
    targets_rad = about_the_centre(steps_rad, half_space_rad * drawn[:, 2], half_space_rad)
    onset_s = timing.onset_s + 0.5 * (1.0 - _DURATION_SHARE) * timing.duration_s
    return Movements(onset_s, _DURATION_SHARE * timing.duration_s, targets_rad)


def turning_tremor(source: SyntheticSource, stream: Stream, t_s: Array) -> Array:
    """Return the trembling of the orientation at times (N,) as rotation vectors (N, 3) in rad."""
    return wander(stream, t_s, _TREMOR_HZ, _TREMOR_RAD * source.turn_deg / USUAL_TURN_DEG)
