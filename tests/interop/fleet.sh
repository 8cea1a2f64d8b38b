#!/usr/bin/env bash
# Measures the cost of a fleet of dampers for a Zenoh router: runs `zenoh_fleet` in several sizes in its own network namespace, with
# one real damper to record. Prints a line of JSON for each size. node/docs/fleet.md reports the results.
#
# usage: fleet.sh [VEHICLES[:SUPERVISORS[:KEYS[:upper]]]...]      default: 10 50 100 250
#
# With `upper`, the supervisors are clients of a second router, to which the first router connects.
#
# Needs: tests/interop/setup.sh router; cargo build --release --workspace --bins --example zenoh_fleet
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(cd "$here/../.." && pwd)
built=${CARGO_TARGET_DIR:-$root/target}/release
router=${MR_DAMPER_INTEROP_DIR:-/var/tmp/mr-damper-interop}/router/fleet-router

for program in "$built/mr-damper" "$built/examples/zenoh_fleet" "$router"; do
  [ -x "$program" ] || {
    echo "fleet.sh: $program is missing; the top of this file lists the requirements" >&2
    exit 2
  }
done
if [ "${1:-}" != --inside ]; then
  exec "$here/netns.sh" run "${BASH_SOURCE[0]}" --inside "$@"
fi
shift
[ $# -gt 0 ] || set -- 10 50 100 250

folder=$(mktemp -d)
started=()
finish() {
  kill "${started[@]}" 2>/dev/null || true
  wait
  rm -rf "$folder"
}
trap finish EXIT

"$built/mr-damper" simulate --experiment RP-ICPS --replicates 1 --out "$folder/run" --quiet >/dev/null
"$built/mr-damper" node --ros-args -p model:=thesis/fuzzy-tanh/rp3-cs \
  -p "zenoh.listen:=['tcp/127.0.0.1:7447']" 2>"$folder/node.log" &
started+=($!)
"$built/mr-damper" replay "$folder/run/rp-icps-01.csv" --loop >/dev/null 2>"$folder/replay.log" &
started+=($!)
for size in "$@"; do
  IFS=: read -r vehicles supervisors keys upper <<<"$size"
  # Each size has its own router, so that the router's memory is the memory for this size.
  sed 's|127.0.0.1:7447|127.0.0.1:7448|' "$root/launch-configs/zenoh/storage.json5" >"$folder/router.json5"
  routers=() further=()
  if [ -n "${upper:-}" ]; then
    sed 's|127.0.0.1:7447|127.0.0.1:7449|' "$root/launch-configs/zenoh/storage.json5" >"$folder/upper.json5"
    "$router" "$folder/upper.json5" 2>"$folder/upper.log" &
    routers+=($!) further=(--upper tcp/127.0.0.1:7449)
    # This router stores nothing and connects to the upper one.
    echo '{mode: "router", listen: {endpoints: ["tcp/127.0.0.1:7448"]}, connect: {endpoints: ["tcp/127.0.0.1:7449"]},
      scouting: {multicast: {enabled: false}}}' >"$folder/router.json5"
  fi
  "$router" "$folder/router.json5" 2>"$folder/router.log" &
  process=$!
  routers+=("$process")
  started+=("${routers[@]}")
  sleep 1
  "$built/examples/zenoh_fleet" --damper tcp/127.0.0.1:7447 --router tcp/127.0.0.1:7448 --router-pid "$process" "${further[@]}" \
    --vehicles "$vehicles" --supervisors "${supervisors:-1}" --keys "${keys:-mr_damper/**/web/*}"
  kill -INT "${routers[@]}"
  wait "${routers[@]}" || true
done
