#!/usr/bin/env bash
# An estimator of your own (my_filter.py) beside those of tis: one twin, then a comparison over three delays.
# Usage: examples/own_estimator.sh [FOLDER [DURATION_S [DELAYS_MS]]]
set -euo pipefail
mkdir -p "${1:-runs/own_estimator}"
folder=$(cd "${1:-runs/own_estimator}" && pwd)
duration_s=${2:-20}
delays_ms=${3-33,100,200}  # given as an empty word: no comparison
cd "$(dirname "$0")"  # a module is looked for in the current folder first

tis twin default --duration-s "$duration_s" --run-dir "$folder/twin" --no-report --no-merge \
    --set 'estimators=[hold, innovations_kf, my_filter:AlphaBeta]' --set active_estimator=my_filter:AlphaBeta
[ -z "$delays_ms" ] || tis compare default --duration-s "$duration_s" --seeds 2 --out "$folder/compare" \
    --estimators hold,innovations_kf,my_filter:AlphaBeta --sweep network.forward.delay.delay_ms="$delays_ms"
