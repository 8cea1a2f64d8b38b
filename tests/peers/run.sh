#!/usr/bin/env bash
# Identification beside Python's own tools, on the same data, in one run: numpy (ARX), scipy's MINPACK (tanh with 15
# coefficients, 25 restarts) and anfis-toolbox (27 rules). Prints both with their ratio; exit code 1 when a goal is
# missed (10 times faster than scipy, 30 times than anfis-toolbox at no greater error, ARX no slower than numpy).
#
# usage: tests/peers/run.sh [EPOCHS]       EPOCHS of ANFIS, on both sides; by default 8 (50 take two minutes in Python)
#
# Needs cargo, python3 with venv, and a package index once. What is kept lies in $MR_DAMPER_PEERS_DIR
# (default /var/tmp/mr-damper-peers).
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
# Built first, so that the compiler does not disturb the times.
cargo build --release --quiet -p mr-damper-model --example peers
"$dir/venv/bin/python" tests/peers/peers.py "$dir" "$epochs"
exec "${CARGO_TARGET_DIR:-target}/release/examples/peers" "$dir" "$epochs"
