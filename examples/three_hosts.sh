#!/usr/bin/env bash
# The three sides as three separate commands, as on three hosts, here all on loopback.
# The patient's clock is set 3 s ahead and 50 ppm fast, to show that no clock needs to be synchronised.
# Usage: examples/three_hosts.sh [FOLDER [SCENARIO]]
set -euo pipefail
folder=${1:-runs/three_hosts}
scenario=${2:-$(dirname "$0")/three_hosts.yaml}
trap 'kill $(jobs -p) 2> /dev/null || true' EXIT

TIS_CLOCK_SKEW=3:50 tis patient "$scenario" --run-dir "$folder/on_patient" --wait-s 60 & patient=$!
tis surgeon "$scenario" --run-dir "$folder/on_surgeon" --wait-s 60 & surgeon=$!
tis netem "$scenario" --run-dir "$folder/on_netem" --wait-s 60 & netem=$!
wait "$patient"
wait "$surgeon"
wait "$netem"

mkdir -p "$folder/gathered"  # on three hosts: tis collect
cp "$folder"/on_*/*.mcap "$folder/gathered"
tis summarize "$folder/gathered"
