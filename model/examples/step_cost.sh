#!/usr/bin/env bash
# Counts the instructions of one step with valgrind: the difference between two run lengths, divided by the difference in steps.
#
# usage: step_cost.sh [WHAT...]     WHAT: a step of the example step_cost; default all
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
command -v valgrind >/dev/null || { echo "valgrind is missing: apt-get install valgrind" >&2; exit 1; }
cargo build --release --quiet -p mr-damper-model --example step_cost
program=${CARGO_TARGET_DIR:-target}/release/examples/step_cost

instructions() { # WHAT COUNT
  valgrind --tool=callgrind --callgrind-out-file=/dev/null "$program" "$1" "$2" 2>&1 |
    sed -n 's/.*Collected : //p'
}

[ $# -gt 0 ] || mapfile -t all < <("$program" list)
[ $# -gt 0 ] || set -- "${all[@]}"
printf 'instructions per step, including the motion itself (nothing)\n'
for what; do
  short=$(instructions "$what" 20000)
  long=$(instructions "$what" 60000)
  printf '  %-32s %6d\n' "$what" $(((long - short) / 40000))
done
