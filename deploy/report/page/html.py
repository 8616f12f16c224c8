"""``report.html``: the report of a run as one self-contained page."""

from typing import Final

from tis.deploy.report.page.html_page import Page, page_html
from tis.deploy.report.page.sections import sections
from tis.deploy.report.run_view import RunView

_LEAD: Final = (
    "One run of the testbed: a surgeon's hand moves a master, an emulated network delays and loses its samples, and "
    "the patient's side estimates where the robot arm should be now. How late, how lossy and how accurate was that?"
)


def report_html(run: RunView) -> str:
    """Return the page of a run; it names what its logs lack."""
    name = run.scenario.name
    title = f"{name}: report of a run{' (synthetic)' if run.synthetic else ''}"
    return page_html(Page(title, name, _tags(run), sections(run), _LEAD))


def _tags(run: RunView) -> list[tuple[str, str]]:
    """Return the marks below the title: validity, origin and mode of the run."""
    summary = run.summary
    kinds = {"live": "live: real processes, real time", "twin": "twin: virtual time"}
    tags = [("valid measurement", "good") if summary["valid"] else ("not a valid measurement", "bad")]
    if run.synthetic:
        tags.append(("synthetic movement, not a recording of a person", "open"))
    tags += [(summary["source"], ""), (kinds.get(summary["mode"], summary["mode"]), "")]
    return [*tags, (f"seed {summary['seed']}", ""), (f"{summary['duration_s']:g} s", "")]
