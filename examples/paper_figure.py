"""A column-wide figure from the logs of a run: the share of ticks whose error is at most so many mm.

Usage: python examples/paper_figure.py RUN_DIR FIGURE.pdf
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt

from tis.deploy.report import load

COLUMN_WIDTH_IN = 3.5  # a column of a two-column IEEE page


def main() -> None:
    """Draw the figure that the command line asks for and print what it shows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run_dir", type=Path)
    parser.add_argument("figure", type=Path)
    given = parser.parse_args()

    run = load(given.run_dir)
    if run.problems:
        raise SystemExit("not a valid measurement: " + "; ".join(run.problems))
    hand = run.scenario.source.hands[0]
    track = run.tracks[hand]

    plt.rcParams.update({"font.size": 8, "pdf.fonttype": 42})  # text stays text in the PDF
    figure, axes = plt.subplots(figsize=(COLUMN_WIDTH_IN, 2.2), layout="constrained")
    for name in track.estimates:
        error_mm = np.sort(run.error_mm(name, hand)[track.scored])  # a missing estimate is NaN and sorts last
        share_pct = 100 * np.arange(1, len(error_mm) + 1) / len(error_mm)
        axes.plot(error_mm, share_pct, label=name, linewidth=1)
        print(f"{name:16} {len(error_mm)} ticks, median {np.median(error_mm):.2f} mm, p99 "
              f"{np.percentile(error_mm, 99):.2f} mm")  # fmt: skip
    axes.set(xlabel="3D position error / mm", ylabel="share of ticks / %", xlim=(0, None), ylim=(0, 100))
    axes.legend(frameon=False)
    # Without a date, the same run gives the same file.
    figure.savefig(given.figure, metadata={"CreationDate": None} if given.figure.suffix == ".pdf" else None)


if __name__ == "__main__":
    main()
