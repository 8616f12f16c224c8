"""The scoreboard's tables: rows and stability in ``docs/studies/scoreboard``, as `tis score` wrote them."""

import json
import re
from collections.abc import Callable, Sequence
from typing import Any, Final

from from_code.study_tables import DOCS
from tis.deploy.studies.score.stability import tables, words

Row = dict[str, Any]
_LINK: Final = re.compile(r"^\[The rows\]\([./]*studies/scoreboard/(\w+)\)\n", re.MULTILINE)
_STABILITY: Final = re.compile(r"^\[The stability\]\([./]*studies/scoreboard/(\w+\.json)\)\n", re.MULTILINE)


def rows_of(track: str) -> list[Row]:
    """Read the rows of a track, the best first."""
    files = sorted((DOCS / "studies" / "scoreboard" / track).glob("*.json"))
    rows = [json.loads(file.read_text(encoding="utf-8")) for file in files]
    return sorted(rows, key=lambda row: (row["score"], row["estimator"]))


def put_in(text: str, rows_of: Callable[[str], Sequence[Row]] = rows_of) -> str:
    """Return a page with tables in place of the links to the rows of a track, and to the ranking's stability."""
    with_rows = _LINK.sub(lambda found: _table(rows_of(found[1])), text)
    return _STABILITY.sub(lambda found: _stability(found[1]), with_rows)


def _stability(name: str) -> str:
    found = json.loads((DOCS / "studies" / "scoreboard" / name).read_text(encoding="utf-8"))
    parts = [f"{words(found)}.", *(table.markdown() for table in tables(found))]
    return "\n\n".join(parts) + "\n"


def _table(rows: Sequence[Row]) -> str:
    if not rows:
        return "There is no row yet.\n"
    names = list(rows[0]["settings"])
    heads = ["estimator", "score", "cover", "step", *names]
    lines = [f"| {' | '.join(heads)} |", f"|---|{'---:|' * (len(heads) - 1)}"]
    for row in rows:
        low, high = row["score_interval_95"]
        cover = "none" if row["coverage_pct"] is None else f"{row['coverage_pct']:.1f}"
        ratios = [f"{row['settings'][name]['ratio_to_hold']:.3f}" for name in names]
        step = f"{row['machine']['step_ratio']:.3g}"
        cells = [f"`{row['estimator']}`", f"{row['score']:.3f} ({low:.3f}-{high:.3f})", cover, step, *ratios]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"
