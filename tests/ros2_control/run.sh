#!/usr/bin/env bash
# Tests the ros2_control controller of launch-configs/ros2_control with models that mr-damper exports.
#
# usage: tests/ros2_control/run.sh       MR_DAMPER_BIN: the program; default target/release/mr-damper
#
# 1. The core, which has no ROS in it, must have the service's bits. This needs a C and a C++ compiler.
# 2. If CMake is on PATH: a build without a model, or with one that does not exist, must say what to do.
# 3. If ros2_control is found (AMENT_PREFIX_PATH, as after `source /opt/ros/jazzy/setup.bash`): the package is built, and the plugin is
#    loaded and run, also in a controller manager. Otherwise a line says that this part did not run.
set -euo pipefail
shopt -s inherit_errexit

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
package=$root/launch-configs/ros2_control
program=$(realpath "${MR_DAMPER_BIN:-$root/target/release/mr-damper}")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

fail() {
  echo "tests/ros2_control/run.sh: $*" >&2
  exit 1
}

# A preset with an effect that has memory, one that needs the case temperature, and one of the load cell.
"$program" presets thesis/fuzzy-tanh/rp3-cs >"$work/preset.toml"
grep -q '^effects = \[\]$' "$work/preset.toml" || fail "the preset no longer has the line 'effects = []', which this script replaces"
lag='{ id = "coil_lag", form = "one_tau", tau_s = 0.01 }'
fade='{ id = "thermal_fade", fade_per_k = -0.002 }'
delay='{ id = "sensor_delay", delay_s = 0.003 }'
sed "s/^effects = \[\]\$/effects = [$lag, $fade, $delay]/" "$work/preset.toml" >"$work/effects.toml"
# The same preset with a measured velocity.
sed 's/^velocity = "backward"$/velocity = "measured"/' "$work/preset.toml" >"$work/velocity.toml"
! cmp --silent "$work/preset.toml" "$work/velocity.toml" || fail "the preset has no line 'velocity = \"backward\"', which this script replaces"

# test_core NAME MODEL [OPTION]...: exports, compiles, and compares.
test_core() {
  local name=$1 out=$work/$1
  "$program" export "$2" --c "$out" --name "$name" --vectors "$out/vectors.csv" "${@:3}" >/dev/null 2>"$work/export.log" ||
    fail "the export of $2 failed: $(cat "$work/export.log")"
  mkdir -p "$out/mr_damper_controller"
  # What CMake's configure_file does.
  sed "s/@MR_DAMPER_C_NAME@/$name/g; s/@MR_DAMPER_C_UPPER@/${name^^}/g" "$package/include/mr_damper_controller/model.hpp.in" \
    >"$out/mr_damper_controller/model.hpp"
  cc -std=c99 -O2 -ffp-contract=off -Wall -Wextra -Werror -c "$out/$name.c" -o "$out/model.o"
  c++ -std=c++17 -O1 -Wall -Wextra -Werror -I"$package/include" -I"$out" "$package/test/core_test.cpp" "$package/test/allocations.cpp" \
    "$out/model.o" -o "$out/core_test"
  printf 'core, %s: ' "$name"
  "$out/core_test" "$out/vectors.csv"
}
test_core damper thesis/fuzzy-tanh/rp3-cs
test_core inverse thesis/fuzzy-tanh/rp3-cs --inverse search --current-max 2 --rate-max 100
test_core passive thesis/arx-passive/rp-icps
test_core effects "$work/effects.toml"
test_core velocity "$work/velocity.toml"

# must_say TEXT OPTION...: CMake must refuse the options with this text in its message.
must_say() {
  local text=$1
  shift
  ! cmake -S "$package" -B "$work/refused" "$@" >"$work/cmake.log" 2>&1 || fail "CMake accepts $*"
  # CMake breaks lines.
  tr -s ' \n' ' ' <"$work/cmake.log" | grep -qF -- "$text" || fail "CMake does not say '$text' for $*: $(cat "$work/cmake.log")"
  rm -rf "$work/refused"
}
if command -v cmake >/dev/null; then
  must_say "Set MR_DAMPER_MODEL to a model file or preset"
  must_say "has no damper.h; run \`mr-damper export" -DMR_DAMPER_C_DIR="$work"
  must_say "could not export MR_DAMPER_MODEL=no-such-model" -DMR_DAMPER_MODEL=no-such-model -DMR_DAMPER_BINARY="$program"
  must_say "(/nowhere); build the ROS package mr_damper first" -DMR_DAMPER_MODEL=thesis/fuzzy-tanh/rp3-cs -DMR_DAMPER_BINARY=/nowhere
  must_say "MR_DAMPER_C_NAME is '1x'" -DMR_DAMPER_C_NAME=1x
  echo "messages of CMake: as expected"
else
  echo "NOT RUN: messages of CMake; cmake is not on PATH"
fi

# Builds the package, and runs its tests with the installed plugin.
test_plugin() {
  local name=$1 options=$2 test
  cmake -S "$package" -B "$work/$name-build" -DCMAKE_INSTALL_PREFIX="$work/$name-install" -DMR_DAMPER_MODEL=thesis/fuzzy-tanh/rp3-cs \
    -DMR_DAMPER_BINARY="$program" -DMR_DAMPER_EXPORT_OPTIONS="$options" >"$work/cmake.log" 2>&1 &&
    cmake --build "$work/$name-build" --target install >>"$work/cmake.log" 2>&1 ||
    fail "the package does not build: $(tail -n 40 "$work/cmake.log")"
  ! grep 'mr_damper_controller.*warning:' "$work/cmake.log" || fail "the compiler warns, see above"
  echo "plugin, $name:"
  for test in plugin manager; do
    if [ ! -x "$work/$name-build/${test}_test" ]; then
      echo "NOT RUN: ${test}_test; the controller manager is not installed"
      continue
    fi
    AMENT_PREFIX_PATH=$work/$name-install:$AMENT_PREFIX_PATH LD_LIBRARY_PATH=$work/$name-install/lib:${LD_LIBRARY_PATH:-} \
      "$work/$name-build/${test}_test" "$work/$name-build/exported/vectors.csv" "$package/controllers.yaml" 2>"$work/test.log" ||
      fail "$(cat "$work/test.log")"
  done
}
IFS=: read -ra prefixes <<<"${AMENT_PREFIX_PATH:-}"
for prefix in "${prefixes[@]}"; do
  if [ -d "$prefix/share/controller_interface" ]; then
    test_plugin damper ""
    test_plugin inverse "--inverse;search;--current-max;2;--rate-max;100"
    exit 0
  fi
done
echo "NOT RUN: the plugin in ROS; there is no controller_interface on AMENT_PREFIX_PATH (its package is in no registry that this script uses)"
