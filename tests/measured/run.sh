#!/usr/bin/env bash
# Compares every model on measured runs of three real dampers, with whole excitations held out. Prints the table from
# which node/docs/guide/04-evaluate-and-compare.md has a selection, and leaves JSON and report of each comparison in OUT.
#
# usage: tests/measured/run.sh [OUT]      OUT: a new folder, by default one under /tmp
#
# Needs cargo, python3, and the runs: MR_DAMPER_DATA, by default ../shared/data next to the checkout. They belong to
# others and are not in this repository; README.md in this folder gives their sources. Takes half an hour on two cores.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/prepare.sh" "$@"

# compare NAME TRAIN... -- TEST... -- OPTION...
compare() {
  local name=$1 train=() test=()
  shift
  while [ "$1" != -- ]; do train+=("$1"); shift; done
  shift
  while [ "$1" != -- ]; do test+=("$1"); shift; done
  shift
  echo "$name: ${#train[@]} runs train, ${#test[@]} test" >&2
  "$mr_damper" compare --train "${train[@]}" --test "${test[@]}" --semi-active-only --filter none "$@" \
    --report "$out/$name.html" --json "$out/$name.json" >"$out/$name.txt"
}

utfsm=$data/utfsm-mr
compare utfsm "$utfsm"/sine-{10mm,25mm,5mm3hz}*.csv -- "$utfsm"/sine-{2mm5hz,5mm4hz}*.csv -- \
  --velocity slope --slope-window 0.01 --rate 200

# Four levels of command voltage: each is held out once.
utfpr=$data/utfpr-mr
v0=("$utfpr"/ensaio{1,1-1,2-1,3-1,4-1,4a,5-1,6-1,7-1,8-1,8a,9-1,10-1,14a}.csv)
v1=("$utfpr"/ensaio[0-9]*-2.csv)
v2=("$utfpr"/ensaio-B-*.csv)
v3=("$utfpr"/ensaio-A-*.csv)
options=(--velocity slope --slope-window 0.03)
compare utfpr-0.00v "${v1[@]}" "${v2[@]}" "${v3[@]}" -- "${v0[@]}" -- "${options[@]}"
compare utfpr-0.87v "${v0[@]}" "${v2[@]}" "${v3[@]}" -- "${v1[@]}" -- "${options[@]}"
compare utfpr-1.98v "${v0[@]}" "${v1[@]}" "${v3[@]}" -- "${v2[@]}" -- "${options[@]}"
compare utfpr-3.21v "${v0[@]}" "${v1[@]}" "${v2[@]}" -- "${v3[@]}" -- "${options[@]}"

# One run of 24.6 s: the first half trains, the second is held out.
nees=$data/nees-mr/ranran-50.csv
rm -f "$out"/nees-{first,second}.csv
"$mr_damper" --quiet convert "$nees" "$out/nees-first.csv" --duration 12.3
"$mr_damper" --quiet convert "$nees" "$out/nees-second.csv" --start 12.3
compare nees "$out/nees-first.csv" -- "$out/nees-second.csv" -- --velocity measured --rate 300.48

python3 tests/measured/table.py "$out"
echo "reports: $out" >&2
