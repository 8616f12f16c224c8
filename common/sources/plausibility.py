"""Plausibility checks of recordings: signs of wrong units, gaps, jumps, and filled-in rows.

They are warnings; an implausible recording is played nevertheless. A recorder that loses rows leaves a step of any
size: over a still arm none, over a slow one some millimetres. No absolute bound finds those without also finding the
brisk movements of other recordings, so a jump is a step far larger than the recording's own, within a slow movement.
"""

from typing import Final

import numpy as np

from tis.common.sources.trajectory import Array, PoseTrack, Recording

FAR: Final = "further than any arm: are these millimetres?"
MAX_REACH_M: Final = 2.0
"""The span of human arms; a da Vinci arm reaches less than half of it. Larger ranges are in wrong units."""

_TIMES_LARGE: Final = 5.0
_LARGE_SHARE: Final = 0.99
# Of 23 trials the largest steps of 21 are 0.9 to 3 times the trial's 99th percentile of steps; one has a step of 3.9,
# another one of 5.6 to 10, by device, where rows are missing.
_TIMES_NEIGHBOURS: Final = 4.0  # a minimum-jerk reach that spans three rows has 2.8, a jump in those trials 10 to 15
_MIN_ACCELERATION_M_S2: Final = 5.0  # half of gravity: 6 mm from one row to the next at 30 Hz
_MAX_STEPS: Final = 2  # into and out of one wrong row


def jumps(position_m: Array, rate_hz: float) -> list[int]:
    """Return the rows before which positions (N, 3) in m jump: such a row begins a new stretch.

    One or two steps, each five times larger than 99 % of the recording's (those that move), stand alone: the steps
    before and after are at most a quarter of them. None are found where wrong units are likely. Oracle: movements
    with rows cut out, reaches of any speed, and 23 recorded trials, test_plausibility.
    """
    sizes_m = np.linalg.norm(np.diff(position_m, axis=0), axis=1)
    moving_m = sizes_m[sizes_m > 0]
    if not len(moving_m) or float(np.ptp(position_m, axis=0).max()) > MAX_REACH_M:
        return []
    usual_m = float(np.quantile(moving_m, _LARGE_SHARE, method="lower"))  # of few steps, all but the largest
    large = sizes_m > max(_TIMES_LARGE * usual_m, _MIN_ACCELERATION_M_S2 / rate_hz**2)
    found: list[int] = []
    for first, last in runs_of(large):
        beside = [sizes_m[i] for i in (first - 1, last + 1) if 0 <= i < len(sizes_m)]
        alone = _TIMES_NEIGHBOURS * max(beside, default=0.0) <= sizes_m[first : last + 1].min()
        if alone and last - first < _MAX_STEPS:
            found += range(first + 1, last + 2)
    return found


def stretches(recording: Recording) -> list[tuple[int, int]]:
    """Return the uninterrupted stretches of a recording, each as its first row and the row after its last.

    All devices are cut where one of them jumps, as a recorder loses the rows of all, and what an arm does after its
    master has jumped is no answer to the rows before.
    """
    tracks: list[PoseTrack] = [track for hand in recording.hands for track in (hand.command, hand.follower)]
    cuts = sorted({row for track in tracks for row in jumps(track.position_m, recording.rate_hz)})
    return list(zip([0, *cuts], [*cuts, len(recording)], strict=True))


def runs_of(holds: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> list[tuple[int, int]]:
    """Return the first and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(np.int8)))
    return [(int(first), int(stop) - 1) for first, stop in edges.reshape(-1, 2)]


# A minimum-jerk reach of 0.2 m in 0.2 s peaks at 5.77 * 0.2 / 0.2^2 = 29 m/s^2 (Flash & Hogan 1985), three times
# gravity; work with instruments stays far below. At 30 Hz a jump of 33 mm between two rows has this acceleration.
_MAX_ACCELERATION_M_S2: Final = 30.0
# Rounding to steps of r moves a row by r / 2 at most, so a second difference by 2 r, of three axes by 2 r sqrt 3.
_MOST_ROUNDED: Final = 2.0 * 3.0**0.5
# Masters resolve micrometres and a hand that holds one trembles by more; arms stand still while a clutch is pressed.
_MAX_STANDSTILL_S: Final = 2.0
# Recorded trials have 24 to 31 rows per second by this measure: the recorder's filter of velocities lowers it.
_MAX_RATE_RATIO: Final = 2.0
RATES_HZ: Final = (3.0, 5000.0)
"""Usual rates of recorders."""
_CALM_HZ: Final = 10.0
_MAX_VEHICLE_M_S2: Final = 15.0
"""One and a half times gravity; millimetres of a hand that are taken for m have a hundred times as much."""
_WIDE_M: Final = 1.0
_BACK_WITHIN: Final = 4
_BACK_SHARE: Final = 0.25
"""A spike is back within so many rows, at so small a share of its size from where it began."""
_LIKE_BEFORE: Final = 1.5
_MAX_SHOWN: Final = 3
_NOISY_SHARE: Final = 0.05
"""Share of the rows from which on bends of the path are the sensor's noise. Rare ones are jumps."""
_TIMES_NOISE: Final = 6.0
_MEDIAN_TO_SIGMA: Final = 1.4826
_SIGMA_OF_BENDS: Final = 6.0**0.5
"""Standard deviation of the second difference of white noise, over that of the noise."""
_SIGMAS: Final = {1: _SIGMA_OF_BENDS, 3: 70.0**0.5}
"""The same, by how often steps are differenced: binomial coefficients, squared and summed."""
_LEAST_STEPS: Final = 4


def anomalies(
    position_m: Array, rate_hz: float, device: str, hand_held: bool, unit_named: bool = False
) -> tuple[str, ...]:
    """Return sentences on the implausibilities of positions (N, 3) in m, at ``rate_hz`` rows per second.

    ``hand_held``: the device is a master, which a hand moves; an arm may stand still. ``unit_named``: somebody says
    that the unit is this one; a far movement is then in doubt only where no vehicle would move like that. Rows count
    from 0. With wrong units, jumps are not searched for. Oracle: movements with known damage, test_plausibility.
    """
    reach_m = float(np.ptp(position_m, axis=0).max())
    if reach_m > MAX_REACH_M and not (unit_named and _is_of_a_vehicle(position_m, rate_hz)):
        return (f"{device} moves over {reach_m:.3g} m, {FAR}",)
    found = [*_wide(position_m, rate_hz, device)] if hand_held else []
    found += [*_zeros(position_m, device), *_jumps(position_m, rate_hz, device)]
    if hand_held:
        found += _standstills(position_m, rate_hz, device)
    return tuple(found)


def _is_of_a_vehicle(position_m: Array, rate_hz: float) -> bool:
    """Tell whether accelerations are those of drones and rovers, by ten rows a second, so that no noise counts."""
    every = max(1, round(rate_hz / _CALM_HZ))
    steps_m = np.diff(position_m[::every], axis=0)
    bends_m_s2 = np.linalg.norm(np.diff(steps_m, axis=0), axis=1) * (rate_hz / every) ** 2
    return not len(bends_m_s2) or float(np.quantile(bends_m_s2, _LARGE_SHARE)) <= _MAX_VEHICLE_M_S2


def _wide(position_m: Array, rate_hz: float, device: str) -> list[str]:
    """Return a sentence where a master's range is that of a stretched arm, and it crosses it within a second.

    A hand's movement in a unit of ten times its size does; drones and rovers take longer for as much.
    """
    reach_m = float(np.ptp(position_m, axis=0).max())
    if not _WIDE_M < reach_m <= MAX_REACH_M:
        return []
    every = max(1, round(rate_hz / _CALM_HZ))
    speeds_m_s = np.linalg.norm(np.diff(position_m[::every], axis=0), axis=1) * rate_hz / every
    if not len(speeds_m_s) or float(np.quantile(speeds_m_s, _LARGE_SHARE)) <= reach_m:
        return []
    return [f"{device} moves over {reach_m:.3g} m, and fast: does a hand, or is the unit ten times too large?"]


def rate_doubts(position_m: Array, velocity_m_s: Array, rate_hz: float, device: str) -> tuple[str, ...]:
    """Return a sentence if recorded velocities (N, 3) contradict ``rate_hz``: speed over distance per row is a rate.

    A file without times does not tell its rate otherwise. Root mean squares are compared, as velocities may lead or
    lag; velocities of 0 were not recorded. Oracle: sampled sines, test_plausibility.
    """
    steps_m = np.diff(position_m, axis=0)
    moved, speed = float(np.sum(steps_m**2)), float(np.sum(velocity_m_s[1:] ** 2))
    in_other_units = float(np.ptp(position_m, axis=0).max()) > MAX_REACH_M  # which `anomalies` says
    if moved == 0 or speed == 0 or in_other_units:
        return ()
    found_hz = (speed / moved) ** 0.5
    near = rate_hz / _MAX_RATE_RATIO <= found_hz <= rate_hz * _MAX_RATE_RATIO
    if near or not RATES_HZ[0] <= found_hz <= RATES_HZ[1]:  # columns that hold no velocities tell nothing
        return ()
    rule = f"taken for {rate_hz:g} rows per second; by its velocities it has {found_hz:.3g}"
    return (f"{device} is {rule}: resample it, or set the velocities to 0 if they are wrong",)


# Rovers begin at their origin, and others cross it: what is reached and left at a usual speed was not filled in.
_TIMES_USUAL: Final = 4.0


def _zeros(position_m: Array, device: str) -> list[str]:
    steps_m = np.linalg.norm(np.diff(position_m, axis=0), axis=1)
    usual_m = float(np.median(steps_m[steps_m > 0])) if steps_m.any() else 0.0
    spans = [
        (first, last)
        for first, last in runs_of((position_m == 0.0).all(axis=1))
        if max(*steps_m[max(0, first - 1) : first], *steps_m[last : last + 1], 0.0) > _TIMES_USUAL * usual_m
    ]
    if not spans:
        return []
    return [f"{device} is at exactly 0 0 0 in {_named(spans)}: were rows filled in?"]


def _jumps(position_m: Array, rate_hz: float, device: str) -> list[str]:
    steps_m = np.diff(position_m, axis=0)
    sizes_m = np.linalg.norm(steps_m, axis=1)
    # A jump accelerates the path where it begins and where it ends; of neighbouring steps it is the longest.
    largest_m = _MAX_ACCELERATION_M_S2 / rate_hz**2 + _MOST_ROUNDED * _resolution_m(steps_m)
    sizes_of_bends_m = np.linalg.norm(np.diff(steps_m, axis=0), axis=1)
    bends = sizes_of_bends_m > largest_m
    noise_m = _noise_m(steps_m)
    of_noise_m = _TIMES_NOISE * _SIGMA_OF_BENDS * noise_m
    said = []
    if of_noise_m > largest_m:  # at many rows a second a little noise bends the path as no hand does
        if bends.mean() > _NOISY_SHARE:
            said = [f"{device} has noise of {1000 * noise_m:.2g} mm between rows: is this the sensor's?"]
        bends = sizes_of_bends_m > of_noise_m
    bent = [(first, last + 1) for first, last in runs_of(bends)]
    fast = [first + int(np.argmax(sizes_m[first : last + 1])) for first, last in bent]
    # Smaller ones stand out from this recording's own movement.
    alone = [row - 1 for row in jumps(position_m, rate_hz)]
    places = sorted({*fast, *(step for step in alone if not any(first <= step <= last for first, last in bent))})
    places = [place for place in places if not _stops(sizes_m, place)]
    spikes = [place for place in places if _is_back(position_m, place)]
    gone = [place for place in places if place not in spikes]
    if gone:
        shown = _steps(gone, sizes_m)
        said.append(f"{device} jumps as no hand moves it, from row {shown}: are rows missing? If so, cut it there")
    if spikes:
        shown = _steps(spikes, sizes_m)
        said.append(
            f"{device} leaves its path and is back within {_BACK_WITHIN} rows, from row {shown}: are these wrong "
            "readings? If so, put what lies between their neighbours there"
        )
    return said


def _steps(places: list[int], sizes_m: Array) -> str:
    """Return steps as their rows and sizes."""
    shown = ", ".join(f"{place} to {place + 1} ({1000 * sizes_m[place]:.0f} mm)" for place in places[:_MAX_SHOWN])
    return shown + (f" and {len(places) - _MAX_SHOWN} more times" if len(places) > _MAX_SHOWN else "")


def _stops(sizes_m: Array, place: int) -> bool:
    """Tell whether a step is as large as the one before it, and none follows: a row that is repeated, no jump."""
    return (
        0 < place < len(sizes_m) - 1
        and sizes_m[place + 1] == 0.0
        and bool(sizes_m[place] <= _LIKE_BEFORE * sizes_m[place - 1])
    )


def _is_back(position_m: Array, place: int) -> bool:
    """Tell whether the rows around the step behind row ``place`` lie where the path was before."""
    near_m = _BACK_SHARE * float(np.linalg.norm(position_m[place + 1] - position_m[place]))
    before = range(max(0, place + 1 - _BACK_WITHIN), place + 1)
    return any(
        float(np.linalg.norm(position_m[last] - position_m[first])) < near_m
        for first in before
        for last in range(place + 1, min(first + _BACK_WITHIN + 1, len(position_m)))
    )


def _noise_m(steps_m: Array) -> float:
    """Return the standard deviation of the noise of the noisiest axis, by the medians of the path's differences.

    White noise has the same in second and in fourth differences; a brisk movement has more in the second ones.
    """
    if len(steps_m) < _LEAST_STEPS:
        return 0.0
    differences_m = {sigma: np.abs(np.diff(steps_m, n, axis=0)) for n, sigma in _SIGMAS.items()}
    sizes_m = [np.median(found, axis=0).max() / sigma for sigma, found in differences_m.items()]
    return float(min(sizes_m)) * _MEDIAN_TO_SIGMA


def _resolution_m(steps_m: Array) -> float:
    """Return the least movement of an axis from row to row, a step of rounded positions; 0 without any."""
    moved_m = np.abs(steps_m[steps_m != 0.0])
    return float(moved_m.min()) if len(moved_m) else 0.0


def _standstills(position_m: Array, rate_hz: float, device: str) -> list[str]:
    same = (np.diff(position_m, axis=0) == 0.0).all(axis=1)
    spans = [(first, last + 1) for first, last in runs_of(same) if last + 1 - first > _MAX_STANDSTILL_S * rate_hz]
    if not spans:
        return []
    longest_s = max(last - first for first, last in spans) / rate_hz
    return [
        f"{device} repeats one position to the last digit for up to {longest_s:.1f} s, in {_named(spans)}: "
        "did the recorder stand still?"
    ]


def _named(spans: list[tuple[int, int]]) -> str:
    shown = ", ".join(f"{first}-{last}" if last > first else str(first) for first, last in spans[:_MAX_SHOWN])
    return f"rows {shown}" + (f" and {len(spans) - _MAX_SHOWN} more spans" if len(spans) > _MAX_SHOWN else "")
