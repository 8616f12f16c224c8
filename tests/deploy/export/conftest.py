"""The run that the tests of the logs make too."""

from tests.deploy.logs.conftest import run_dir, scenario, touch_dir

__all__ = ["run_dir", "scenario", "touch_dir"]
