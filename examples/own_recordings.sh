#!/usr/bin/env bash
# A recording of your own, identified, then played over a bad network in virtual time.
# Usage: examples/own_recordings.sh [FOLDER]
set -euo pipefail
here=$(dirname "$0")
folder=${1:-runs/own_recordings}

tis identify "$here/own_recording.yaml" --set "source.path=$here/own_recording.csv"
tis twin "$here/own_recording.yaml" --set "source.path=$here/own_recording.csv" \
    --run-dir "$folder/twin" --no-report --no-merge
