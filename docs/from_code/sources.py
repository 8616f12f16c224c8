"""Product's names that the generated pages are read off: when a module moves, only this file follows."""

from pathlib import Path
from typing import Final

from common import channels, errors, host_records, records, safety_records
from common.devices import records as device_records
from common.scenario import Scenario
from common.scenario.base import Part
from common.sources.jigsaws import MAX_TRIAL_BYTES
from common.yaml_text import MAX_YAML_BYTES
from deploy.cli.main import app
from deploy.compare.study import Study
from deploy.export.columns import columns_of, table_meaning
from deploy.hosts.hosts_file import HostsFile, LocalHost, NamespaceHost, SshHost
from deploy.logs import limits
from deploy.run.conclude import Outputs
from deploy.run.resolve import resolve
from deploy.run.virtual import run_virtual
from deploy.shell.run_dir import MAX_JSON_BYTES
from deploy.shell.shipped_scenarios import shipped_names
from patient_side.identification.model_io import MAX_MODEL_BYTES

API: Final = {
    "Identification": (
        "patient_side.identification.identify",
        ("identify_arm", "identify_hands", "identify_with_orders", "Identified"),
    ),
    "Estimators": ("patient_side.estimators.protocol", ("Estimator", "Estimate")),
    "What an estimator reads": ("patient_side.playout", ("Playout", "SourceBuffer")),
    "Runs": ("deploy.report", ("load", "Run")),
    "Comparisons": ("deploy.compare", ("compare", "Study", "Comparison")),
    "The network's models, on arrays": ("netem.expected.simulate", ("simulate", "Simulated")),
    "A link": ("netem.link.link", ("Link",)),
}
"""The public API by the title of its section: the module and its members."""

HOST_KINDS: Final = (SshHost.__name__, NamespaceHost.__name__, LocalHost.__name__)
RECORD_MODULES: Final = (records, device_records, host_records, safety_records)
SIDE_PACKAGES: Final = {"surgeon": "surgeon_side", "netem": "netem", "patient": "patient_side"}
ROOT: Final = Path(__file__).resolve().parents[2]
NOTEBOOKS: Final = ("run_in_python", "compare_in_python")

__all__ = [
    "API",
    "HOST_KINDS",
    "MAX_JSON_BYTES",
    "MAX_MODEL_BYTES",
    "MAX_TRIAL_BYTES",
    "MAX_YAML_BYTES",
    "NOTEBOOKS",
    "RECORD_MODULES",
    "ROOT",
    "SIDE_PACKAGES",
    "HostsFile",
    "Outputs",
    "Part",
    "Scenario",
    "Study",
    "app",
    "channels",
    "columns_of",
    "errors",
    "limits",
    "resolve",
    "run_virtual",
    "shipped_names",
    "table_meaning",
]  # fmt: skip
