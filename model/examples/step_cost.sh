#!/usr/bin/env bash
# Instructions that one step takes, by valgrind: the difference between two lengths, over their difference.
#
# usage: step_cost.sh [WHAT...]     what: as the example step_cost says; all of them by default
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
printf 'instructions a step, those of the motion itself (nothing) among them\n'
for what; do
  short=$(instructions "$what" 20000)
  long=$(instructions "$what" 60000)
  printf '  %-32s %6d\n' "$what" $(((long - short) / 40000))
done
