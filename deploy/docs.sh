#!/usr/bin/env bash
# Builds the manual strictly, from nothing, so that no page of an earlier build hides a link that leads nowhere.
set -euo pipefail
cd "$(dirname "$0")/.."
export PATH="$PWD/.venv/bin:$PATH"
sphinx-build --fail-on-warning --keep-going --nitpicky --fresh-env --quiet -d docs/_build/doctrees docs docs/_build/html
