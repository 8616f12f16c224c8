#!/usr/bin/env bash
# The one check: format, lint, types, import contracts, manual, tests. Stops at the first that fails, but for types and
# manual: these are made meanwhile at a low priority, told as soon as they are known, and count at the end.
# Arguments are pytest's: without any, all tests run.
set -euo pipefail
cd "$(dirname "$0")/.."
export PATH="$PWD/.venv/bin:$PATH"
# without compiled files each of the many processes below would compile the whole project, and pytest all tests
unset PYTHONDONTWRITEBYTECODE
ruff format --check .
ruff check --no-cache .
lint-imports
nice mypy &  # live tests come first, and often wait
types=$!
nice deploy/docs.sh &
manual=$!
trap 'kill $types $manual 2> /dev/null || true' EXIT
# the tests are compiled once, which each worker would do again
pytest --collect-only --quiet > /dev/null || true  # a fault is told below
# one worker more than cores, for live tests mostly wait; these come first, as tests/conftest.py sorts them
pytest -n 3 --dist loadgroup --no-loadscope-reorder --durations=25 "$@"
wait $manual || { echo "the manual cannot be built: see sphinx-build's lines above" >&2; exit 1; }
wait $types || { echo "the types are wrong: see mypy's lines above" >&2; exit 1; }
