#!/usr/bin/env bash
# The recording converted, checked and identified, then played over a bad network in virtual time.
# Usage: examples/own_recordings.sh [FOLDER]
set -euo pipefail
here=$(dirname "$0")
folder=${1:-runs/own_recordings}
source="{kind: jigsaws, path: $folder/recordings, task: Suturing, trial: A001, hands: [left]}"

python "$here/own_recordings.py" "$here/own_recording.csv" "$folder/recordings"
tis identify default --set "source=$source" --set identification.train_samples=600
tis twin default --set "source=$source" --set identification.train_samples=600 --duration-s 15 \
    --run-dir "$folder/twin" --no-report --no-merge
