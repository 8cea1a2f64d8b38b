#!/usr/bin/env bash
# Builds the fuzz targets and runs them, a minute or an hour each. README.md describes the targets and what to do if one fails.
#
# usage: tests/fuzz/run.sh [--seconds N | --hour | --build] [--jobs N] [--seed N] [TARGET...]      all targets, 60 s each, 2 at a time
#
# Coverage of our crates guides the search for inputs; with --hour, coverage of all crates. --build runs nothing.
#
# Starts from the committed corpora and the inputs found by earlier runs. Those are kept below the target directory
# (tests/fuzz/target, or $CARGO_TARGET_DIR/fuzz), as are logs and failing inputs. The source tree is not changed.
# Exit codes: 0 nothing found; 1 a target failed or did not build; 2 wrong usage; 130 interrupted.
set -euo pipefail
shopt -s inherit_errexit nullglob

# Largest resident memory of a target in MB; src/lib.rs has the tighter limit on single allocations.
rss_limit_mb=512
# Longest time for one input in s; inputs have a few kB.
timeout_s=5

usage() {
  sed -n '4s/^# //p' "${BASH_SOURCE[0]}" >&2
  exit 2
}

# Seed 0: a different seed each time.
seconds=60 jobs=2 seed=0 whole='' build_only='' targets=()
while [ $# -gt 0 ]; do
  case $1 in
    --seconds) seconds=${2:-} && shift ;;
    --hour) seconds=3600 whole=yes ;;
    --build) build_only=yes ;;
    --jobs) jobs=${2:-} && shift ;;
    --seed) seed=${2:-} && shift ;;
    -*) usage ;;
    *) targets+=("$1") ;;
  esac
  shift || usage
done
[[ $seconds =~ ^[1-9][0-9]*$ && $jobs =~ ^[1-9][0-9]*$ && $seed =~ ^[0-9]+$ ]] || usage

out=${CARGO_TARGET_DIR:+$(realpath -m "$CARGO_TARGET_DIR")/fuzz}
cd "$(dirname "${BASH_SOURCE[0]}")"
out=${out:-$PWD/target}
known=(fuzz_targets/*.rs)
known=("${known[@]##*/}") known=("${known[@]%.rs}")
[ ${#targets[@]} -gt 0 ] || targets=("${known[@]}")
for target in "${targets[@]}"; do
  [ -f "fuzz_targets/$target.rs" ] || {
    echo "unknown target '$target'; targets are ${known[*]}" >&2
    exit 2
  }
done

# Compiler flags of `cargo fuzz --sanitizer none`: coverage for libFuzzer, all checks. Our crates have no unsafe code for a
# sanitizer to check.
coverage=(-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4
  -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table
  -Cllvm-args=-sanitizer-coverage-trace-compares --cfg fuzzing -Cdebug-assertions)
if [ -n "$whole" ]; then
  # Naming the host as target keeps these flags out of build scripts and macros.
  host=$(rustc -vV | sed -n 's/^host: //p')
  env -u CARGO_ENCODED_RUSTFLAGS RUSTFLAGS="${coverage[*]}" \
    cargo build --release --locked --target "$host" --target-dir "$out" --bins
  programs=$out/$host/release
else
  # Only our crates are compiled. The project's tests use the same target directory, and have compiled the other crates.
  shared=$(realpath -m "${CARGO_TARGET_DIR:-../../target}")
  RUSTC_WRAPPER=$PWD/instrument.sh MR_DAMPER_FUZZ_COVERAGE=${coverage[*]} cargo build --locked --target-dir "$shared" --bins
  programs=$shared/debug
fi
[ -z "$build_only" ] || exit 0

# Targets read files: in memory if possible.
scratch=$(mktemp -d -p "$([ -w /dev/shm ] && echo /dev/shm || echo "${TMPDIR:-/tmp}")" mr-damper-fuzz.XXXXXX)
declare -A running=() # process: target
interrupted=''
trap 'interrupted=yes' INT TERM
trap 'rm -rf "$scratch"' EXIT

begin() {
  local target=$1 work=$out/work/$1 dictionary=()
  mkdir -p "$work/corpus" "$work/found" "$scratch/$target" "corpus/$target"
  [ -f "dict/$target.dict" ] && dictionary=(-dict="dict/$target.dict")
  # Its own process group: Ctrl-C reaches only this script, which then ends the targets in order.
  TMPDIR=$scratch/$target setsid "$programs/$target" "$work/corpus" "corpus/$target" "${dictionary[@]}" \
    -seed="$seed" -max_total_time="$seconds" -rss_limit_mb=$rss_limit_mb -timeout=$timeout_s -artifact_prefix="$work/found/" \
    -print_final_stats=1 </dev/null >"$work/log" 2>&1 &
  running[$!]=$target
}

last() { sed -n "s/$2/\\1/p" "$out/work/$1/log" | tail -n 1; }

failed=()
end() {
  local target=$1 code=$2 what='nothing found' artifact
  artifact=$(last "$target" '.*Test unit written to \(.*\)')
  # libFuzzer exits with 72 if it is interrupted.
  if [ "$code" != 0 ] && ! { [ "$code" = 72 ] && [ -n "$interrupted" ]; }; then
    what="FAILED (exit code $code)" && failed+=("$target")
  fi
  printf '%-15s %10s runs  %7s/s  %6s features  %s\n' "$target" \
    "$(last "$target" '^stat::number_of_executed_units: *\([0-9]*\)')" "$(last "$target" '^stat::average_exec_per_sec: *\([0-9]*\)')" \
    "$(last "$target" '^#.* ft: \([0-9]*\) .*')" "$what"
  if [ "$what" != 'nothing found' ]; then
    echo "  its log: $out/work/$target/log"
    [ -z "$artifact" ] || echo "  the input: $artifact; replay it with: $programs/$target $artifact"
  fi
}

rounds=$(((${#targets[@]} + jobs - 1) / jobs))
echo "fuzzing ${#targets[@]} targets, $seconds s each, $jobs at a time: $((rounds * seconds)) s"
waiting=("${targets[@]}") began=$SECONDS told=0
while [ ${#running[@]} -gt 0 ] || [ ${#waiting[@]} -gt 0 ]; do
  while [ -z "$interrupted" ] && [ ${#waiting[@]} -gt 0 ] && [ ${#running[@]} -lt "$jobs" ]; do
    begin "${waiting[0]}"
    waiting=("${waiting[@]:1}")
  done
  if [ -n "$interrupted" ]; then
    waiting=()
    for process in "${!running[@]}"; do kill -INT "$process" 2>/dev/null || true; done
  fi
  # Ends early on a signal, which is handled above.
  sleep 1 || true
  for process in "${!running[@]}"; do
    kill -0 "$process" 2>/dev/null && continue
    code=0
    wait "$process" || code=$?
    end "${running[$process]}" "$code"
    unset "running[$process]"
  done
  left=$((rounds * seconds - SECONDS + began))
  if [ -z "$interrupted" ] && [ ${#running[@]} -gt 0 ] && [ $((SECONDS - told)) -ge 30 ] && [ $left -gt 0 ]; then
    echo "  ... ${running[*]}; $left s left"
    told=$SECONDS
  fi
done

[ ${#failed[@]} = 0 ] || {
  echo "failed targets: ${failed[*]}; README.md says what to do" >&2
  exit 1
}
[ -z "$interrupted" ] || exit 130
