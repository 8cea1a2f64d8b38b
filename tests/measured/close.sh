#!/usr/bin/env bash
# Runs the diagnosis on measured runs of four real dampers and an axis: the tables of node/docs/guide/08-diagnosis.md. Prints for each
# machine the verdict, the named effects and the error on the test run (`--test`, "sealed"), and leaves text, JSON and report
# in OUT.
#
# usage: tests/measured/close.sh [OUT]      OUT: a new folder, by default one under /tmp
#
# Needs cargo, python3, and the same runs as run.sh. Takes 90 s on two cores once everything is built.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/prepare.sh" "$@"

# close_loop NAME OPTION...
close_loop() {
  local name=$1
  shift
  echo "$name" >&2
  rm -f "$out/$name.toml"
  "$mr_damper" close "$@" --out "$out/$name.toml" --report "$out/$name.html" --json "$out/$name.json" \
    >"$out/$name.txt"
}

# A run of 24.6 s in three parts: blocks of 0.8 s instead of 3 s, because there would be too few blocks.
nees=$data/nees-mr/ranran-50.csv
rm -f "$out"/nees-{estimate,confirm,test}.csv
"$mr_damper" --quiet convert "$nees" "$out/nees-estimate.csv" --duration 10
"$mr_damper" --quiet convert "$nees" "$out/nees-confirm.csv" --start 10 --duration 3
"$mr_damper" --quiet convert "$nees" "$out/nees-test.csv" --start 13
close_loop nees --estimate "$out/nees-estimate.csv" --confirm "$out/nees-confirm.csv" --test "$out/nees-test.csv" \
  --filter none --velocity measured --rate 1000 --block-s 0.8

utfsm=$data/utfsm-mr
close_loop utfsm --estimate "$utfsm"/sine-{10mm,25mm}*.csv --confirm "$utfsm"/sine-5mm3hz*.csv \
  --test "$utfsm"/sine-{5mm4hz,2mm5hz}*.csv --rate 200

# Levels 0, 1.98 and 3.21 V; training, validation and test runs have different excitations.
utfpr=$data/utfpr-mr
close_loop utfpr --estimate "$utfpr"/ensaio-{A-{1,2,3,4,5},B-{1,3,5,6}}.csv "$utfpr"/ensaio{1,{1,2,3,4,5,6}-1}.csv \
  --confirm "$utfpr"/ensaio-{A-{6,7},B-{7,8}}.csv "$utfpr"/ensaio{7,8}-1.csv \
  --test "$utfpr"/ensaio-{A-{8,9,10},B-{9,10}}.csv "$utfpr"/ensaio{9,10}-1.csv

# A positioning axis with published values: its mass is beyond the range of dampers.
emps=$data/emps/emps-estimation.csv
rm -f "$out"/emps-{estimate,confirm,test}.csv
"$mr_damper" --quiet convert "$emps" "$out/emps-estimate.csv" --duration 12.5
"$mr_damper" --quiet convert "$emps" "$out/emps-confirm.csv" --start 12.5 --duration 4
"$mr_damper" --quiet convert "$emps" "$out/emps-test.csv" --start 16.5
emps() {
  close_loop "$1" --base linear --passive --block-s 1 --estimate "$out/emps-estimate.csv" --confirm "$out/emps-confirm.csv" \
    --test "$out/emps-test.csv" "${@:2}"
}
emps emps --range inertia=0:200
emps emps-terms --effects none

# A car damper without a coil on a crank, with another gas pressure, and before and after a heat gun. The reference runs are not aligned by
# hand. In the two runs at 50 and 150 psi the load cell is reversed: without `sign=-1` they are refused.
dyno=$data/dyno/dyno
# cut NAME RUN OPTION...
cut() {
  local name=$1 run=$2
  shift 2
  rm -f "$out/$name.csv"
  "$mr_damper" --quiet convert "$run" "$out/$name.csv" "$@"
}
# changed NAME: what has changed from $out/NAME-healthy-{1,2}.csv to $out/NAME-{1,2}.csv
changed() {
  close_loop "$1" --base sp --passive --reference "$out/$1"-healthy-{1,2}.csv --estimate "$out/$1-1.csv" --confirm "$out/$1-2.csv"
}
for psi in healthy-:50 :150; do
  run=$dyno-t1-1-1-18-18-s5-n10-${psi#*:}psi.csv
  cut "gas-${psi%:*}1" "$run" --duration 8.2 --map measured_force=force_n,sign=-1
  cut "gas-${psi%:*}2" "$run" --start 8.2 --map measured_force=force_n,sign=-1
done
changed gas
for heat in heat-24:t1-3-3-24-24 heat-12:t2-2-2-12-12; do
  run=$dyno-${heat#*:}-s5-n100-100psi-with-heat-gun.csv
  name=${heat%:*}
  cut "$name-healthy-1" "$run" --duration 19
  cut "$name-healthy-2" "$run" --start 19 --duration 8
  cut "$name-1" "$run" --start 66.1 --duration 19
  cut "$name-2" "$run" --start 85.1 --duration 8
  changed "$name"
done

python3 - "$out" <<'PYTHON'
import json, pathlib, sys

for name in "nees", "utfsm", "utfpr", "emps", "emps-terms", "gas", "heat-24", "heat-12":
    closing = json.loads((pathlib.Path(sys.argv[1]) / f"{name}.json").read_text())
    if test := closing["test"]:
        low, high = test["ratio_ci95"] or (float("nan"), float("nan"))
        error = (f"test-run NMSE {test['before']['esr']:.4f} -> {test['after']['esr']:.4f}, "
                 f"squared error left {100 * test['ratio']:.1f} % ({100 * low:.1f} to {100 * high:.1f})")
    else:
        error = f"reducible error left on the validation run {100 * closing['left_over']['share']:.0f} %"
    print(f"{name}: {closing['verdict']}, {error}, {closing['seconds']:.0f} s")
    if shift := closing["mean_shift"]:
        low, high = shift["ci95_n"]
        print(f"    mean force {shift['force_n']:+.1f} N ({low:.1f} to {high:.1f}): {', '.join(shift['causes']) or 'chance'}")
    for effect in closing["effects"]:
        print("   ", effect["id"], effect.get("class", ""), effect["parameters"])
    for term in closing["terms"]:
        print("   ", term["equation"])
    if closing["base_fault"]:
        print("   ", closing["base_fault"])
PYTHON
echo "reports: $out" >&2
