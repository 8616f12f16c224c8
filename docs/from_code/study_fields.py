"""Page of the study file's fields, read off the model that checks it."""

from from_code.scenario_fields import fields_table
from from_code.sources import Study

_HEAD = """# Study file

A study file is a YAML file for `tis compare --study`; in Python, `tis.deploy.compare.Study` has the same fields. How
it is used: [compare estimators](../testbed/compare_estimators.md#studies).
"""


def page() -> str:
    """Return the page."""
    schema = Study.model_json_schema(mode="validation")
    parts = schema["$defs"]
    ranges = fields_table(parts["Range"], parts, "")
    return "\n".join([_HEAD, fields_table(schema, parts, ""), "", "## A range of values", "", ranges, ""])
