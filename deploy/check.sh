#!/usr/bin/env bash
# The one check: format, lint, types, import contracts, manual, tests. Stops at the first that fails.
set -euo pipefail
cd "$(dirname "$0")/.."
export PATH="$PWD/.venv/bin:$PATH"
# without compiled files each of the many processes below would compile the whole project, and pytest all tests
unset PYTHONDONTWRITEBYTECODE
ruff format --check .
ruff check --no-cache .
mypy
lint-imports
deploy/docs.sh
# one worker more than cores, for live tests mostly wait; these come first, as tests/conftest.py sorts them
pytest -n 3 --dist loadgroup --no-loadscope-reorder --durations=25 "$@"
