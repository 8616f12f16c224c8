"""The page of `tis paper`, generated from results; only the paper's own figures are typed by hand."""

from collections.abc import Iterable, Sequence
from math import sqrt
from typing import Any, Final

from tis.common.scenario.network.pipeline import Pipeline
from tis.common.units import NS_PER_MS
from tis.deploy.studies.paper.cells import (
    PAIRINGS,
    READINGS,
    SAMPLES,
    TOPOLOGIES,
    Cell,
    Method,
    Pairing,
    Results,
    SimulationKey,
    meaningful,
)
from tis.deploy.studies.paper.markdown import axes_text, table
from tis.deploy.studies.paper.printed import BLOCK_ROWS, ORDER, ROWS, TEXT, TRAIN_SAMPLES, PaperRow, PaperText
from tis.deploy.studies.paper.simulation import Reading
from tis.netem.stages.delay import latency_of

# Section on the figures in the paper's text, which no row of its tables has, beside ours.

Axis = float | None


def text_section(results: Results) -> str:
    """Return the section. Oracle: figures written by hand, test_text_section."""
    key = nearest_simulation(results)
    _, number, reading, _ = key
    ours = results.simulated[key].score
    row = min(ROWS, key=lambda each: _distance(each.accuracy_pct, TEXT.accuracy_pct))
    printed: list[tuple[str, PaperRow | PaperText]] = [
        ("the paper's text", TEXT),
        *((f"its table, row {each.number}", each) for each in ROWS),
    ]
    lines = [_line(name, each.accuracy_pct, each.rmse) for name, each in printed]
    lines.append(_line(f"ours, row {number} read as {reading}", ours["r2_pct"], ours["rmse_normalized"]))
    head = ("", "accuracy in %, x y z", "RMSE, x y z", "implied deviation, x y z")
    of_table = _distance(row.accuracy_pct, TEXT.accuracy_pct)
    of_ours = _distance(ours["r2_pct"], TEXT.accuracy_pct)
    low, high = _span_of_x(each for _, each in printed)
    return f"""## The figures in the paper's text

The section that describes the plots names no network. Its figures are in no row of the table: the nearest is
row {row.number}, which differs by up to {of_table:.2f} points of accuracy. Of our runs of Algorithm 1 on the
same-name pair that of row {number}, read as {reading}, is nearest to the text, within {of_ours:.2f} points;
`tis paper` draws it.

{table(head, lines)}

An accuracy that is R\u00b2 and a RMSE imply the deviation of the signal, RMSE / sqrt(1 - R\u00b2). On one trial it is
one number for each axis, whatever the network. What the paper prints implies {low:.3f} to {high:.3f} for x: its
rows and its text are not of one signal, or their accuracy is not R\u00b2 of the signal that the RMSE is of."""


def nearest_simulation(results: Results) -> SimulationKey:
    """Return the run of Algorithm 1 on the same-name pair whose accuracy is nearest to the text's on every axis."""
    own = [key for key in results.simulated if key[0] == "same_name" and not key[3]]
    return min(own, key=lambda key: _distance(results.simulated[key].score["r2_pct"], TEXT.accuracy_pct))


def implied_deviation(accuracy_pct: Sequence[Axis], rmse: Sequence[Axis]) -> list[Axis]:
    """Return the standard deviation of each axis that R\u00b2 in % and RMSE imply; None where one is unknown."""
    return [
        None if r2 is None or error is None or r2 >= 100 else error / sqrt(1 - r2 / 100)
        for r2, error in zip(accuracy_pct, rmse, strict=True)
    ]


def _line(name: str, accuracy_pct: Sequence[Axis], rmse: Sequence[Axis]) -> tuple[str, str, str, str]:
    implied = implied_deviation(accuracy_pct, rmse)
    return name, axes_text(accuracy_pct), axes_text(rmse, 4), axes_text(implied, 3)


def _span_of_x(printed: Iterable[PaperRow | PaperText]) -> tuple[float, float]:
    """Return the smallest and the largest deviation of x that printed figures imply."""
    found = [implied_deviation(each.accuracy_pct, each.rmse)[0] for each in printed]
    known = [value for value in found if value is not None]
    return min(known), max(known)


def _distance(ours: Sequence[Axis], theirs: Sequence[float]) -> float:
    """Return the largest difference over the axes; infinite where one of ours is unknown."""
    pairs = zip(ours, theirs, strict=True)
    return max(float("inf") if one is None else abs(one - other) for one, other in pairs)


WITHIN_POINTS: Final = 8.0
_PAIR: Final[dict[Pairing, str]] = {"same_name": "same-name pair (columns 1-3 to 39-41)", "cross": "true pair"}


def page(results: Results) -> str:
    """Return the page."""
    parts = [
        _opening(results),
        _network(),
        _simulation(results),
        _epsilons(results),
        text_section(results),
        _packets(results),
        _conclusions(results),
        _closing(results),
    ]
    return "\n\n".join(parts) + "\n"


def _opening(results: Results) -> str:
    energy = {pairing: results.models[pairing, "moesp_paper"] for pairing in PAIRINGS}
    radius = {pairing: f"{model.spectral_radius:.4f}" for pairing, model in energy.items()}
    return f"""# The paper, computed again

Lashari, Batayneh, Khokhar and Ahmed, "Enhanced Position Estimation in Tactile Internet-Enabled Remote Robotic Surgery
Using MOESP-Based Kalman Filter", on the JIGSAWS trial {results.label}, left master. This page is written by `tis paper`.

**How to read it.** The paper's "estimation accuracy" is not defined in it. Its figures are consistent with
100 R\u00b2 = 100 (1 - SSE / SST) on min-max normalised signals, so that is what stands here; the reading is *inferred*. R\u00b2
is given for x y z. RMSE is in units of the training rows' range. Everything is run in virtual time, so it repeats exactly.

- *ms*: the network delays are milliseconds, as the table says. *samples*: they are sample periods (1/30 s), as a program
  that forgets to divide by dt would treat them.
- *same-name pair*: master left with columns 39-41, as the paper's figures suggest. *true pair*: the arm that really follows
  that master (columns 58-60, found in the data).
- *observer*: the commands arrive clean and only the arm's measurements cross the network, as in the paper.
  *teleoperation*: everything the surgeon sends crosses it, as it does for a patient's side.
- *in sample*: the filter runs over the whole trial, its first {TRAIN_SAMPLES} rows being those the model was identified on, as in the
  paper. *held out*: only over the rows after them.
- `paper` is Algorithm 1 with its update repaired; `paper_as_printed` restarts from the prediction for every output channel,
  as the listing does. Both use the paper's identification: order {ORDER}, {BLOCK_ROWS} block rows, {TRAIN_SAMPLES} samples, empirical Q and R.
  `moesp_kf` is the testbed's own filter on its own model; `hold` repeats the newest position that arrived.

The paper's model has spectral radius {radius["same_name"]} on the same-name pair and {radius["cross"]} on the true pair."""


def _network() -> str:
    head = ("row", "n_d, ms", "n_j, ms", "loss, %", "mean delay really asked for, ms", "its deviation, ms")
    rows = []
    for row in ROWS:
        asked = latency_of(
            Pipeline.model_validate(
                {
                    "delay": {"kind": "uniform", "low_ms": row.low_ms, "high_ms": row.high_ms},
                    "jitter": {"kind": "normal", "std_ms": row.jitter_ms},
                }
            ),
            {},
        )
        mean_ms, std_ms = asked.mean_ns / NS_PER_MS, asked.std_ns / NS_PER_MS
        rows.append(
            (row.number, row.delay_text, f"{row.jitter_ms:g}", f"{row.loss_pct:g}", f"{mean_ms:.3f}", f"{std_ms:.3f}")
        )
    return f"""## The six networks

n_j is called a variance in the paper and used as a standard deviation. Where delay plus jitter would be negative it is
drawn again, which makes the mean larger than n_d, in row 5 by more than a quarter.

{table(head, rows)}"""


def _simulation(results: Results) -> str:
    blocks = []
    for pairing in PAIRINGS:
        head = "row|reading|mean delay, samples|paper prints|`paper`|within 8?|`paper_as_printed`|RMSE, paper prints|RMSE, `paper`"
        rows = []
        for row, reading in _readings():
            fixed = results.simulated[pairing, row.number, reading, False]
            printed = results.simulated[pairing, row.number, reading, True]
            rows.append(
                (
                    row.number,
                    reading,
                    f"{fixed.mean_delay_samples:.2f}",
                    axes_text(row.accuracy_pct),
                    axes_text(fixed.score["r2_pct"]),
                    _within(row, fixed.score["r2_pct"]),
                    axes_text(printed.score["r2_pct"]),
                    axes_text(row.rmse, 3),
                    axes_text(fixed.score["rmse_normalized"], 3),
                )
            )
        blocks.append(f"### {_PAIR[pairing].capitalize()}\n\n{table(head.split('|'), rows)}")
    n_near, n_all = _near(results, "same_name", "samples")
    n_near_ms, _ = _near(results, "same_name", "ms")
    tables = "\n\n".join(blocks)
    return f"""## The paper's own simulation

Algorithm 1 on the arrays of the whole trial: the measurement of sample k is `PSM[k - round(n_d / dt + randn n_j / dt)]`, which
reads the *future* when the draw is negative. Order {ORDER}, {BLOCK_ROWS} block rows, whole trial, in sample. On the same-name pair, of rows 1-5,
{n_near} of {n_all} lie within {WITHIN_POINTS:g} points of the paper on every axis when delays are read as samples, {n_near_ms} of {n_all} when read as ms.

{tables}

{_outside(results)}

Read as ms, rows 1-5 draw no delay of even one sample at 30 Hz: they can differ only by lost samples, and so cannot give
the different figures that the paper prints. Row 6 in samples would delay by up to 167 s, longer than the trial:
it is meaningless and left out."""


def _epsilons(results: Results) -> str:
    head = ("epsilon_Q", "epsilon_R", "R\u00b2 %, x y z", "RMSE, x y z")
    rows = [
        (f"{q:g}", f"{r:g}", axes_text(score["r2_pct"]), axes_text(score["rmse_normalized"], 3))
        for (q, r), score in results.epsilons.items()
    ]
    return f"""## What the paper leaves open: the first guess of Q and R

The paper does not give its epsilons. Row 3 in samples, same-name pair, `paper`:

{table(head, rows)}"""


def _packets(results: Results) -> str:
    blocks = []
    names: tuple[tuple[str, Method], ...] = (
        ("paper", "moesp_paper"),
        ("paper_as_printed", "moesp_paper"),
        ("moesp_kf", "moesp"),
        ("hold", "moesp"),
    )
    for topology in TOPOLOGIES:
        for pairing in PAIRINGS:
            for sample in SAMPLES:
                if Cell(ROWS[0], READINGS[0], pairing, topology, sample, "moesp") not in results.cells:
                    continue  # left out by --quick
                head = ("row", "reading", "paper prints", *(f"`{name}`" for name, _ in names), "`moesp_kf` / hold")
                rows = []
                for row, reading in _readings():
                    scores = [
                        results.cells[Cell(row, reading, pairing, topology, sample, method)][name]
                        for name, method in names
                    ]
                    ratio = scores[2]["ratio_to_hold"]
                    axes = [axes_text(score["r2_pct"]) for score in scores]
                    rows.append((row.number, reading, axes_text(row.accuracy_pct), *axes, f"{ratio:.2f}"))
                blocks.append(f"### {topology}, {_PAIR[pairing]}, {sample}\n\n{table(head, rows)}")
    n_tables = len(TOPOLOGIES) * len(PAIRINGS) * len(SAMPLES)
    if len(blocks) < n_tables:
        blocks.append(f"This page was made with --quick: {len(blocks)} of {n_tables} such tables were computed.")
    tables = "\n\n".join(blocks)
    return f"""## The same filters on packets

Here the network is the testbed's: each packet has its own delay, nothing is known before it arrives, and an estimate is
for the instant of the tick, 2 ms after the sample. R\u00b2 in %, x y z; ratio: 3D RMSE over hold's.

{tables}"""


def _conclusions(results: Results) -> str:
    cells = results.cells
    teleoperation = [_held_out(cells, row, reading, "moesp_kf")["ratio_to_hold"] for row, reading in _readings()]
    beaten = sum(
        all(
            ours >= paper
            for ours, paper in zip(
                _held_out(cells, row, reading, "moesp_kf")["r2_pct"], row.accuracy_pct, strict=True
            )
        )
        for row, reading in _readings()
        if row.number <= 5
    )
    n_rows = sum(row.number <= 5 for row, _ in _readings())
    static = results.models["cross", "moesp"]
    paper_true = results.models["cross", "moesp_paper"]
    return f"""## What holds, what does not, and why

- **The order of magnitude holds when delays are read as samples.** In milliseconds the first five networks delay by less than
  one sample at 30 Hz, so their rows cannot differ as they do in the paper.
- **The pair matters more than the network.** The like-named master and arm have no physical relation; what the filter achieves
  there it achieves by assimilating delayed measurements, not by its model. On the true pair the arm is half its master:
  the testbed's identification finds order {static.order} ({"a static relation" if static.static else "not static"}), while order {ORDER} fits noise
  (spectral radius {paper_true.spectral_radius:.3f}).
- **Dropping D loses the true pair.** Algorithm 1 never uses D. Where D is the whole relation, the filter has nothing but
  the measurements, and the empirical Q and R tell it to trust them too little.
- **As printed, only the last channel is assimilated.** The update restarts from the prediction for each channel; on the
  same-name pair x and y run away, and z alone is good.
- **A late measurement is taken for a present one.** With delays of several samples that is worse than holding the freshest
  value: the filter smooths towards where the arm was.
- **Delays that are drawn negative read the future**, which no network does.
- **The paper's topology is easier than the patient's.** With clean commands and a static arm, the commands alone tell the
  position; in `teleoperation` they are as late as everything else.
- **Velocities are not used here.** JIGSAWS' velocity columns look ahead by some 2.5 frames; an estimator that reads them sees
  the future.
- **What the testbed does better.** On the true pair, everything delayed, held out, `moesp_kf` errs by {min(teleoperation):.2f} to
  {max(teleoperation):.2f} of what hold does. In {beaten} of {n_rows} readings of rows 1-5 its R\u00b2 is above the paper's on every axis."""


def _closing(results: Results) -> str:
    trial = results.trial
    return f"""## How to repeat it

```
TIS_JIGSAWS=/path/to/jigsaws tis paper --task {trial.task} --trial {trial.name} --seed {trial.seed}
```

It also draws the paper's plots, x, y and z over time and the singular values, as SVG and PDF into `runs/paper` (another
folder with `--folder`; they need `pip install 'tis-testbed[report]'`). They show a recorded trial, which may not be
redistributed, so they are not in the manual. `tis paper --methods` measures its comparison of methods:
[methods.md](methods.md).

One trial and one seed: the figures say how the algorithms behave, not how well they do on average."""


def _readings() -> list[tuple[PaperRow, Reading]]:
    return [(row, reading) for row in ROWS for reading in READINGS if meaningful(row, reading)]


def _near(results: Results, pairing: Pairing, reading: Reading) -> tuple[int, int]:
    rows = [row for row in ROWS if row.number <= 5]
    scores = [results.simulated[pairing, row.number, reading, False].score["r2_pct"] for row in rows]
    return sum(_within(row, r2) == "yes" for row, r2 in zip(rows, scores, strict=True)), len(rows)


def _outside(results: Results) -> str:
    """Return a text on those of rows 1-5, read as samples on the same-name pair, that differ by more."""
    sentences = []
    drawn = {n: results.simulated["same_name", n, "samples", False] for n in range(1, 6)}
    for row in ROWS[:5]:
        r2 = drawn[row.number].score["r2_pct"]
        if _within(row, r2) == "yes":
            continue
        off = max((ours - paper for ours, paper in zip(r2, row.accuracy_pct, strict=True)), key=abs)
        sentence = f"Row {row.number} as samples differs by {off:+.1f} points."
        better = [n for n in drawn if n != row.number and _mean(ROWS[n - 1]) > _mean(row)]
        longer = [n for n in better if drawn[n].mean_delay_samples > drawn[row.number].mean_delay_samples]
        if longer:
            sentence += (
                f" The paper prints less for it than for row {longer[0]}, although its delays are shorter on average "
                f"({drawn[row.number].mean_delay_samples:.2f} against {drawn[longer[0]].mean_delay_samples:.2f} samples): "
                "on the same draws the repaired filter does not do that."
            )
        sentences.append(sentence)
    return " ".join(sentences) or "No row differs by more."


def _mean(row: PaperRow) -> float:
    return sum(row.accuracy_pct) / len(row.accuracy_pct)


def _within(row: PaperRow, r2_pct: Sequence[float | None]) -> str:
    off = [abs(ours - paper) for ours, paper in zip(r2_pct, row.accuracy_pct, strict=True) if ours is not None]
    return "yes" if len(off) == len(row.accuracy_pct) and max(off) <= WITHIN_POINTS else "no"


def _held_out(cells: dict[Cell, dict[str, Any]], row: PaperRow, reading: Reading, name: str) -> dict[str, Any]:
    """Return the scores of an estimator on the true pair, with everything delayed, on held-out rows."""
    scores: dict[str, Any] = cells[Cell(row, reading, "cross", "teleoperation", "held out", "moesp")][name]
    return scores
