#!/usr/bin/env bash
# Compiles our crates with coverage for libFuzzer, and all other crates and build scripts as cargo asks. run.sh gives it to cargo as
# RUSTC_WRAPPER.
#
# usage: instrument.sh RUSTC ARGUMENTS...      the flags for coverage are in $MR_DAMPER_FUZZ_COVERAGE
set -euo pipefail

case "${CARGO_PKG_NAME:-} $*" in
  mr-damper-*' --crate-name build_script_'*) exec "$@" ;;
  mr-damper-*)
    read -ra coverage <<<"$MR_DAMPER_FUZZ_COVERAGE"
    exec "$@" "${coverage[@]}"
    ;;
  *) exec "$@" ;;
esac
