from typing import Any

from rich.console import Console

from tests.deploy.report.partial import part
from tis.deploy.report.subjects.orientation import AngleScores, orientation_table


def scores(rms: float | None, ratio: float | None, region_pct: float | None = None) -> Any:
    entry = {"rms": rms, "p95": rms, "max": rms, "ratio_to_hold": ratio, "step_us": {"p50": 61.25, "p99": 90.0}}
    return part(AngleScores, entry | {"region_pct": region_pct})


TURNS = {
    "hold": scores(4.0, 1.0),
    "tangent_ls": scores(2.5, 0.63, 95.0),
    "unscored": scores(None, None),
}
GRIPPERS = {"hold": scores(0.2, 1.0), "tangent_ls": scores(0.05, 0.25, 95.0)}


def test_the_page_shows_degrees_beside_holds_and_marks_the_active_method() -> None:
    page = orientation_table(TURNS, GRIPPERS, "left hand", "tangent_ls").html()
    for text in ("2.50", "63", "95.00", "0.050", "25", "61.25"):
        assert text in page
    assert "unscored" not in page
    assert page.count("class=") >= 1
    assert not orientation_table({}, {}, "left hand", "hold").rows


def test_a_terminal_of_80_columns_shows_every_figure_whole() -> None:
    console = Console(width=80, record=True)
    console.print(orientation_table(TURNS, GRIPPERS, "left hand", "hold").terminal())
    assert not orientation_table({}, {}, "right hand", "hold").rows
    text = console.export_text()
    assert "left hand" in text
    assert "…" not in text
    (line,) = [line.split() for line in text.splitlines() if "tangent_ls" in line]
    assert line == ["tangent_ls", "2.50", "63", "2.50", "2.50", "95.00", "0.050", "25"]


def test_what_the_recording_lacks_has_no_columns() -> None:
    still = {name: scores(None, None) for name in ("hold", "tangent_ls")}

    def heads(turns: Any, grippers: Any) -> list[str]:
        return [column.title for column in orientation_table(turns, grippers, "left hand", "hold").full_columns()]

    whole = heads(TURNS, GRIPPERS)
    assert heads(TURNS, still) == [*whole[:6], whole[8]]
    assert heads(still, GRIPPERS) == [whole[0], *whole[6:]]
