"""The product's names that the generated pages are read off: when a module moves, only this file follows."""

from pathlib import Path
from typing import Final

from common import channels, errors, records
from common.scenario import Scenario
from common.scenario.base import Part
from deploy.cli.main import app
from deploy.export.columns import columns_of, table_meaning
from deploy.run.conclude import Outputs
from deploy.run.resolve import resolve
from deploy.run.virtual import run_virtual
from deploy.shell.shipped_scenarios import shipped_names

API: Final = {
    "Identification": (
        "patient_side.identification.identify",
        ("identify_arm", "identify_with_orders", "Identified"),
    ),
    "Estimators": ("patient_side.estimators.protocol", ("Estimator", "Estimate")),
    "What an estimator reads": ("patient_side.playout", ("Playout", "SourceBuffer")),
    "Runs": ("deploy.report", ("load", "Run")),
    "The network's models, on arrays": ("netem.expected.simulate", ("simulate", "Simulated")),
    "A link": ("netem.link.link", ("Link",)),
}
"""The public API by the title of its section: the module and its members."""

SIDE_PACKAGES: Final = {"surgeon": "surgeon_side", "netem": "netem", "patient": "patient_side"}
ROOT: Final = Path(__file__).resolve().parents[2]
NOTEBOOK: Final = ROOT / "docs" / "run_in_python.ipynb"

__all__ = [
    "API",
    "NOTEBOOK",
    "ROOT",
    "SIDE_PACKAGES",
    "Outputs",
    "Part",
    "Scenario",
    "app",
    "channels",
    "columns_of",
    "errors",
    "records",
    "resolve",
    "run_virtual",
    "shipped_names",
    "table_meaning",
]  # fmt: skip
