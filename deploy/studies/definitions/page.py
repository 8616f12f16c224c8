"""Page ``docs/research/definitions.md``; no figure of ours in it is typed by hand."""

from typing import Any, Final

from tis.deploy.studies.definitions import report as tables
from tis.deploy.studies.definitions.readings import NAMES

COMMAND: Final = "tis compare --definitions --page docs/research/definitions.md"


def page_text(report: dict[str, Any]) -> str:
    """Return the page."""
    blocks = [
        _HEADER,
        f"```\n{report['command']}\n```",
        tables.headline(report),
        "## Ours, under each definition",
        _READINGS,
        tables.readings_markdown(report),
        "## What velocities are worth",
        _VELOCITIES,
        tables.squares_markdown(report),
        "## The published figures",
        _PUBLISHED,
        tables.published_markdown(report),
        *(_said(entry) for entry in report["published"]),
        _CODE,
    ]
    return "\n\n".join(blocks) + "\n"


def _said(entry: dict[str, Any]) -> str:
    """Return what a publication says and leaves open."""
    return "\n".join(
        (
            f"**{entry['name']}**: {entry['figure']}.",
            "",
            f"- Says: {entry['says']}.",
            f"- Leaves open: {'; '.join(entry['leaves_open'])}.",
            f"- Read: {entry['read']}.",
            f"- {entry['citation']}.",
        )
    )


_HEADER: Final = f"""# Definitions side by side

**Context.** Several publications give the error of forecasts on JIGSAWS in mm. "2.71 mm at 1 s" can be many things: a
3D distance or the error of an axis, a root mean square or a mean, at the horizon or over all steps up to it. On the
same forecasts these differ by more than estimators do.

**Decision: our figures under every reading that a published text allows**, in one table, so that a reader sees which
comparisons are fair. This page is written by
`{COMMAND}`;
`TIS_JIGSAWS` names the trials. It takes some 5 minutes of processor time. The same without the page prints the
tables, as data with `--json`:"""

_READINGS: Final = f"""Forecasts of `{NAMES[0]}` and `{NAMES[1]}` in mm: each cell has both, in this order. A
forecast over a horizon is what the estimator says when its newest sample of the arm is exactly that old, as under a
constant delay. There are ten forecasts a second, from 2 s after the beginning on, each over all steps to 2 s. Both
arms are pooled. Jumps in the recordings are scored like any other row.

- **3D RMSE**, **3D mean distance**: root of the mean squared distance; mean of the distance.
- **RMSE, MAE of an axis**: that of x, of y and of z, then the mean of the three.
- **At the horizon**: the error of that one step. **Up to it**: over all steps from the first to the horizon, 30 or 10
  steps a second. The estimators see every sample; the second table shows what a past of 10 Hz costs.
- **One user out**: trained on all other people. **One supertrial out**: trained on all trials with another number,
  the same person's included. **Own trial**: trained on the first rows of the trial and scored after them, so that its
  rows score fewer forecasts."""

_VELOCITIES: Final = """The velocity columns of the recordings are smoothed over later rows: they look 2 to 3 rows
ahead. No estimator of `tis` uses them, since at the patient's side the rows to come are not known. To show what they
are worth, a least-squares forecast of this page's own, one for each number of steps, sees the positions of the last
half second, with and without the velocity at the newest sample (that of the hand which moves the arm). 3D RMSE at the
horizon in mm, one user out:"""

_PUBLISHED: Final = f"""The rows are those of the first table that the text allows; beside them the smallest and the
largest of our figures in these rows. A figure is *comparable* when its text leaves one row and nothing else open.
Only abstracts and opening pages could be read, not the full papers: what they leave open may be closed further on.
One below the range of `{NAMES[1]}` is smaller than ours under every reading that its text allows."""

_CODE: Final = """**In the code.** `deploy/studies/definitions/` (`readings.py`, `splits.py`, `velocity_inputs.py`,
`published.py`), `deploy/compare/cells/forecasts.py`."""
