"""Page of the hosts file's fields, read off the models that check it."""

from from_code.markdown import code, prose
from from_code.scenario_fields import fields_table
from from_code.sources import HOST_KINDS, HostsFile

_HEAD = """# Hosts file

A hosts file is a YAML file for `tis up` and `tis collect`: `scenario`, a scenario file relative to it or the name of
a shipped scenario, and a host for each of `surgeon`, `netem` and `patient`. How it is used:
[runs on several hosts](../testbed/hosts.md).
"""


def page() -> str:
    """Return the page."""
    parts = HostsFile.model_json_schema(mode="validation")["$defs"]
    sections = [_HEAD]
    for name in HOST_KINDS:
        part = parts[name]
        fields = {field: of for field, of in part["properties"].items() if field != "kind"}
        kind = part["properties"]["kind"]["const"]
        sections += [f"## kind: {kind}", "", prose(part["description"]), ""]
        sections += [f"{code('kind')}: {code(kind)}", "", fields_table({**part, "properties": fields}, parts, ""), ""]
    return "\n".join(sections)
