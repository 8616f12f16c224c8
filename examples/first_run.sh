#!/usr/bin/env bash
# A live run, the same run in virtual time, and a replay of the live run's arrivals.
# Usage: examples/first_run.sh [FOLDER [DURATION_S [OPTION OF tis run ...]]]
set -euo pipefail
folder=${1:-runs/first_run}
duration_s=${2:-20}

tis run default --duration-s "$duration_s" --run-dir "$folder/live" "${@:3}"
# The twin draws the fates of the same seed; --against compares them packet by packet.
tis twin default --duration-s "$duration_s" --run-dir "$folder/twin" --against "$folder/live" --no-report --no-merge
tis replay "$folder/live"
