"""Printed results of the paper: "Network Parameters and KF Estimation Accuracy for Tactile Internet Scenarios".

Lashari, Batayneh, Khokhar and Ahmed, "Enhanced Position Estimation in Tactile Internet-Enabled Remote Robotic Surgery
Using MOESP-Based Kalman Filter". n_j is called a variance there and used as a standard deviation.
"""

from dataclasses import dataclass
from typing import Final

Axes = tuple[float, float, float]

BLOCK_ROWS: Final = 10
ORDER: Final = 10
TRAIN_SAMPLES: Final = 1240


@dataclass(frozen=True)
class PaperRow:
    """One row: jitter n_j and the bounds of the delay n_d in ms, loss in per cent, accuracy in per cent, RMSE."""

    number: int
    jitter_ms: float
    low_ms: float
    high_ms: float
    loss_pct: float
    accuracy_pct: Axes
    rmse: Axes

    @property
    def delay_text(self) -> str:
        """Return n_d as the paper writes it."""
        return f"{self.low_ms:g}" if self.low_ms == self.high_ms else f"{self.low_ms:g} - {self.high_ms:g}"


@dataclass(frozen=True)
class PaperText:
    """Figures of the section "Summary of Position x, y, z Graphs", which names no network."""

    accuracy_pct: Axes
    rmse: Axes


TEXT: Final = PaperText((94.80, 95.99, 97.67), (0.0331, 0.0297, 0.0243))

ROWS: Final = (
    PaperRow(1, 0.5, 0.5, 2, 0.01, (96.67, 95.13, 97.52), (0.0363, 0.0308, 0.0333)),
    PaperRow(2, 0.5, 0.5, 2, 0.001, (95.58, 95.61, 97.60), (0.0356, 0.0310, 0.0337)),
    PaperRow(3, 0.1, 1, 1, 0.01, (98.68, 98.70, 99.00), (0.0232, 0.0196, 0.0239)),
    PaperRow(4, 2.0, 5, 5, 0.001, (88.46, 89.32, 93.65), (0.0600, 0.0575, 0.0581)),
    PaperRow(5, 1.0, 1, 1, 0.001, (90.66, 88.67, 93.47), (0.0644, 0.0600, 0.0523)),
    PaperRow(6, 3.0, 200, 5000, 1, (85.95, 87.68, 90.95), (0.0811, 0.0766, 0.0748)),
)
