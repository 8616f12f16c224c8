#!/usr/bin/env bash
# A twin over a lossy network, the figures that tis draws of it, and one drawn by paper_figure.py.
# Usage: examples/paper_figure.sh [FOLDER [DURATION_S [SCENARIO]]]
set -euo pipefail
folder=${1:-runs/paper_figure}
tis twin "${3:-lossy}" --duration-s "${2:-60}" --run-dir "$folder/twin" --no-report --no-merge
tis report "$folder/twin" --figures "$folder/figures" --format pdf
python "$(dirname "$0")/paper_figure.py" "$folder/twin" "$folder/error.pdf"
