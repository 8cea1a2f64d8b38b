#!/usr/bin/env bash
# Compares identification with Python tools on the same data, in one run: numpy (ARX), scipy's MINPACK (tanh with 15
# coefficients, 25 restarts) and anfis-toolbox (27 rules). Prints both results with their ratio; exit code 1 if a goal
# is missed (10 times faster than scipy, 30 times faster than anfis-toolbox at no larger error, ARX no slower than
# numpy).
#
# usage: tests/peers/run.sh [EPOCHS]       EPOCHS of ANFIS for both programs; default 8 (50 take two minutes in Python)
#
# Needs cargo, python3 with venv, and a package index for the first run. The environment is kept in
# $MR_DAMPER_PEERS_DIR (default /var/tmp/mr-damper-peers).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

epochs=${1:-8}
dir=${MR_DAMPER_PEERS_DIR:-/var/tmp/mr-damper-peers}
mkdir -p "$dir"
stamp=$(sha256sum tests/peers/requirements.txt)
if [ "$(cat "$dir/stamp" 2>/dev/null)" != "$stamp" ]; then
  rm -rf "$dir/venv"
  python3 -m venv "$dir/venv"
  "$dir/venv/bin/pip" install --quiet --disable-pip-version-check -r tests/peers/requirements.txt
  echo "$stamp" >"$dir/stamp"
fi
# Built first, so that compilation does not disturb the times.
cargo build --release --quiet -p mr-damper-model --example peers
"$dir/venv/bin/python" tests/peers/peers.py "$dir" "$epochs"
exec "${CARGO_TARGET_DIR:-target}/release/examples/peers" "$dir" "$epochs"
