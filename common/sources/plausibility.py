"""Plausibility checks of recordings: signs of wrong units, gaps, and filled-in rows.

They are warnings; an implausible recording is played nevertheless.
"""

from typing import Final

import numpy as np

from tis.common.sources.jumps import MAX_REACH_M, jumps, runs_of
from tis.common.sources.trajectory import Array

# A minimum-jerk reach of 0.2 m in 0.2 s peaks at 5.77 * 0.2 / 0.2^2 = 29 m/s^2 (Flash & Hogan 1985), three times
# gravity; work with instruments stays far below. At 30 Hz a jump of 33 mm between two rows has this acceleration.
_MAX_ACCELERATION_M_S2: Final = 30.0
# Masters resolve micrometres and a hand that holds one trembles by more; arms stand still while a clutch is pressed.
_MAX_STANDSTILL_S: Final = 2.0
# Recorded trials have 24 to 31 rows per second by this measure: the recorder's filter of velocities lowers it.
_MAX_RATE_RATIO: Final = 2.0
_RATES_HZ: Final = (3.0, 5000.0)  # of recorders
_MAX_SHOWN: Final = 3


def anomalies(position_m: Array, rate_hz: float, device: str, hand_held: bool) -> tuple[str, ...]:
    """Return sentences on the implausibilities of positions (N, 3) in m, at ``rate_hz`` rows per second.

    ``hand_held``: the device is a master, which a hand moves; an arm may stand still. Rows count from 0. With wrong
    units, jumps are not searched for. Oracle: movements with known damage, test_plausibility.
    """
    reach_m = float(np.ptp(position_m, axis=0).max())
    if reach_m > MAX_REACH_M:
        return (f"{device} moves over {reach_m:.3g} m, further than any arm: are these millimetres?",)
    found = [*_zeros(position_m, device), *_jumps(position_m, rate_hz, device)]
    if hand_held:
        found += _standstills(position_m, rate_hz, device)
    return tuple(found)


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
    if near or not _RATES_HZ[0] <= found_hz <= _RATES_HZ[1]:  # columns that hold no velocities tell nothing
        return ()
    rule = f"taken for {rate_hz:g} rows per second; by its velocities it has {found_hz:.3g}"
    return (f"{device} is {rule}: resample it, or set the velocities to 0 if they are wrong",)


def _zeros(position_m: Array, device: str) -> list[str]:
    spans = runs_of((position_m == 0.0).all(axis=1))
    if not spans:
        return []
    return [f"{device} is at exactly 0 0 0 in {_named(spans)}: were rows filled in?"]


def _jumps(position_m: Array, rate_hz: float, device: str) -> list[str]:
    steps_m = np.diff(position_m, axis=0)
    sizes_m = np.linalg.norm(steps_m, axis=1)
    # A jump accelerates the path where it begins and where it ends; of neighbouring steps it is the longest.
    bends = np.linalg.norm(np.diff(steps_m, axis=0), axis=1) * rate_hz**2 > _MAX_ACCELERATION_M_S2
    bent = [(first, last + 1) for first, last in runs_of(bends)]
    fast = [first + int(np.argmax(sizes_m[first : last + 1])) for first, last in bent]
    # Smaller ones stand out from this recording's own movement.
    alone = [row - 1 for row in jumps(position_m, rate_hz)]
    places = sorted({*fast, *(step for step in alone if not any(first <= step <= last for first, last in bent))})
    if not places:
        return []
    shown = ", ".join(f"{place} to {place + 1} ({1000 * sizes_m[place]:.0f} mm)" for place in places[:_MAX_SHOWN])
    rest = f" and {len(places) - _MAX_SHOWN} more times" if len(places) > _MAX_SHOWN else ""
    return [f"{device} jumps as no hand moves it, from row {shown}{rest}: are rows missing?"]


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
