"""Errors of an axis over all steps of a short window: 30 rows in, 10 out, as Weerasinghe et al. score in 2024.

Their code (UVA-DSA/MTRSAP, config.py and train_prediction.py) pools the windows of the person who is left out, and
all 10 steps of each, in one RMSE and one MAE for x, y and z of each arm.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from tis.common.channels import Hand
from tis.common.sources.trajectory import Recording
from tis.deploy.compare.cells.forecasts import ErrorSums
from tis.deploy.studies.definitions.readings import N_AHEAD, NAMES
from tis.deploy.studies.definitions.velocity_inputs import Inputs, leave_user_out

N_IN: Final = 30
N_OUT: Final = 10
LEAST_SQUARES: Final = f"least squares, {N_IN} rows"
_HANDS: Final[tuple[Hand, ...]] = ("left", "right")


def window_rows(results: Iterable[Mapping[str, Any]], recordings: Sequence[Recording]) -> list[dict[str, Any]]:
    """Return a row for each arm and forecast: RMSE and MAE of x, y and z in mm over 10 steps, one user out.

    ``results`` are those of the twins whose person is left out. All are scored on the windows that have two seconds
    of the recording behind them, as in the other tables. The least squares know no more than the 30 rows, the
    estimators all rows before. Oracle: errors by hand, test_windows.
    """
    found = list(results)
    rows = []
    for hand in _HANDS:
        sums = {name: ErrorSums.total(_of(found, hand, name)) for name in NAMES}
        of_hand = [replace(one, hands=tuple(each for each in one.hands if each.hand == hand)) for one in recordings]
        if all(one.hands for one in of_hand):
            sums[LEAST_SQUARES] = leave_user_out(of_hand, Inputs(30, False, N_IN - 1), N_AHEAD)
        rows += [_row(hand, name, each) for name, each in sums.items() if each is not None and each.n]
    return rows


def _of(results: Iterable[Mapping[str, Any]], hand: Hand, name: str) -> list[ErrorSums]:
    return [ErrorSums.from_json(result["forecasts"][hand][name]) for result in results if hand in result["forecasts"]]


def _row(hand: Hand, name: str, sums: ErrorSums) -> dict[str, Any]:
    count = N_OUT * sums.n
    squares_m2, absolute_m = sums.squares_m2[:N_OUT].sum(axis=0), sums.absolute_m[:N_OUT].sum(axis=0)
    return {
        "hand": hand,
        "name": name,
        "n_windows": sums.n,
        "rmse_mm": (1000 * np.sqrt(squares_m2 / count)).tolist(),
        "mae_mm": (1000 * absolute_m / count).tolist(),
    }
