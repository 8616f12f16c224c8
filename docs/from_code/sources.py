"""Product's names that the generated pages are read off: when a module moves, only this file follows."""

from pathlib import Path
from typing import Final

from tis.common import channels, errors
from tis.common.scenario import Scenario
from tis.common.scenario.base import Part
from tis.common.sources.jigsaws import MAX_TRIAL_BYTES
from tis.common.topic import Topic
from tis.common.topics import RECORD_MODULES, TOPICS
from tis.common.yaml_text import MAX_YAML_BYTES
from tis.deploy.cli.main import app
from tis.deploy.compare.study import Study
from tis.deploy.export.tables import unit_of
from tis.deploy.hosts.hosts_file import HostsFile, LocalHost, NamespaceHost, SshHost
from tis.deploy.logs import blocks as limits
from tis.deploy.net.stage_reference import network_page as network_page
from tis.deploy.report.summary import Summary
from tis.deploy.shell.run_dir import MAX_JSON_BYTES
from tis.deploy.shell.shipped_scenarios import shipped_names
from tis.patient_side.identification.model_file import MAX_MODEL_BYTES

API: Final = {
    "Identification": (
        "tis.patient_side.identification.identify",
        ("identify_arm", "identify_hands", "identify_with_orders", "Identified"),
    ),
    "Estimators": ("tis.patient_side.estimators.protocol", ("Estimator", "Estimate")),
    "What an estimator reads": ("tis.patient_side.playout", ("Playout", "SourceBuffer")),
    "Runs": ("tis.deploy.report", ("load", "Run")),
    "Comparisons": ("tis.deploy.compare", ("compare", "Study", "Comparison")),
    "The network's models, on arrays": ("tis.netem.expected.simulate", ("simulate", "Simulated")),
    "A link": ("tis.netem.link.link", ("Link",)),
}
"""The public API by the title of its section: the module and its members."""

HOST_KINDS: Final = (SshHost.__name__, NamespaceHost.__name__, LocalHost.__name__)
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
    "TOPICS",
    "HostsFile",
    "Part",
    "Scenario",
    "Study",
    "Summary",
    "Topic",
    "app",
    "channels",
    "errors",
    "limits",
    "shipped_names",
    "unit_of",
]  # fmt: skip
