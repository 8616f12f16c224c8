"""Tables of the comparison: the paper's, with measured cells beside its words, and one of each measure."""

from collections.abc import Callable, Sequence

from tis.deploy.present.numbers import NONE, per_axis, with_interval
from tis.deploy.present.table import Column, Table
from tis.deploy.studies.methods.claims import CLAIMS, FAMILY_TITLES
from tis.deploy.studies.methods.measured import Figures, exponent_text, loss_head, rate_text


def main_table(methods: Sequence[Figures]) -> Table:
    """Return the paper's table: its features, its words on three families, and a measured cell of each method."""
    said = [Column(f"paper: {title}", words=True) for title in FAMILY_TITLES.values()]
    rows = [[claim.title, *claim.words.values(), *map(claim.cell, methods)] for claim in CLAIMS.values()]
    return Table("", ["feature", *said, *(str(figures["method"]) for figures in methods)], rows)


def detail_tables(methods: Sequence[Figures]) -> dict[str, Table]:
    """Return a table of each measure by its title; those that nothing was measured for have no rows."""

    def by(measure: str, head: Callable[[Figures], str], cell: Callable[[Figures], str | float | None]) -> Table:
        """Return the table of one measure: a row for each method, a column for each of its settings."""
        heads = list(dict.fromkeys(head(entry) for figures in methods for entry in figures[measure]))
        found = {str(figures["method"]): {head(e): cell(e) for e in figures[measure]} for figures in methods}
        rows = [[name, *(cells.get(each) for each in heads)] for name, cells in found.items() if cells]
        return Table("", ["method", *heads], rows)

    return {
        "Ratio to hold by delay": by("accuracy", lambda e: f"{e['delay_ms']:g} ms", _ratio),
        "Ratio to hold by loss": by("loss", loss_head, _ratio),
        "Error by loss, over the method's own without loss": by("loss", loss_head, _growth),
        "R² in %, x y z, by loss": by("loss", loss_head, _r2),
        "Ratio to hold by noise": by("noise", _noise_head, _ratio),
        "Error by noise, over the method's own without noise": by("noise", _noise_head, _growth),
        "Ratio to hold by noise, trained with the same noise": by("noise_trained", _noise_head, _ratio),
        "R² in %, x y z, by noise": by("noise", _noise_head, _r2),
        "Ratio to hold by number of training trials": by("data", lambda e: str(e["n_trials"]), _ratio),
        "Training, s of processor time, by number of training trials": by(
            "data", lambda e: str(e["n_trials"]), lambda e: e["train_s"]
        ),
        "Error after training on others, over that after training on the own person": by(
            "adaptability", lambda e: str(e["trained_on"]), lambda e: with_interval(e["ratio"], _bounds(e))
        ),
        "Reliability": _reliability(methods),
        "Steps": _steps(methods),
        "Exponents": _exponents(methods),
        "Ratio to hold by block rows": by("size", lambda e: str(e["block_rows"]), _ratio),
    }


def _reliability(methods: Sequence[Figures]) -> Table:
    names = {"p50": "p50", "p95": "p95", "p99": "p99", "p100": "largest"}
    shares = (Column("missing", "%"), Column("in 95 % regions", "%"))
    rows = [
        [
            str(figures["method"]),
            _ratio(entry),
            *(entry[f"error_{name}_mm"] for name in names),
            entry["missing_pct"],
            entry["coverage_pct"],
        ]
        for figures in methods
        if (entry := figures["reliability"]) is not None
    ]
    return Table("", ["method", "ratio to hold", *(Column(name, "mm") for name in names.values()), *shares], rows)


def _steps(methods: Sequence[Figures]) -> Table:
    p99, rate = Column("p99", "µs"), Column("highest rate, one hand", show=rate_text)
    times = (Column("p50", "µs"), p99, rate, Column("both hands", show=rate_text))
    at_1_khz = (Column("at 1 kHz: p50", "µs"), p99, "ratio to hold")
    rows = []
    for figures in methods:
        step, fast = figures["step"], figures["fast"]
        if step is not None:
            of_fast = [None] * 3 if fast is None else [fast["step_p50_us"], fast["step_p99_us"], _ratio(fast)]
            measured = [step[name] for name in ("p50_us", "p99_us", "rate_hz", "rate_both_hz")]
            rows.append([str(figures["method"]), *measured, *of_fast, figures["training_s"]])
    return Table("", ["method", *times, *at_1_khz, Column("training", "s")], rows)


def _exponents(methods: Sequence[Figures]) -> Table:
    names = {
        "train_rows": "training by rows",
        "step_rows": "step by rows",
        "train_size": "training by block rows",
        "step_size": "step by block rows",
    }
    laws = {str(figures["method"]): [figures["exponents"][name] for name in names] for figures in methods}
    rows = [[method, *each] for method, each in laws.items() if any(law is not None for law in each)]
    return Table("", ["method", *(Column(head, show=exponent_text) for head in names.values())], rows)


def _noise_head(entry: Figures) -> str:
    return f"{entry['noise_mm']:g} mm"


def _bounds(entry: Figures) -> tuple[float | None, float | None]:
    return entry["low"], entry["high"]


def _ratio(entry: Figures) -> str:
    return with_interval(entry["ratio_to_hold"], _bounds(entry))


def _growth(entry: Figures) -> str:
    growth = entry["growth"]
    return NONE if growth is None else with_interval(growth["ratio"], _bounds(growth))


def _r2(entry: Figures) -> str:
    return per_axis(entry["r2_pct"], 1)
