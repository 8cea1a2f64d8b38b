#!/usr/bin/env bash
# Prepares the peers of the interop tests: two real ROS 2 distributions with our messages compiled in, and one environment with
# CycloneDDS, Zenoh and the bag readers.
#
# usage: setup.sh [jazzy] [kilted] [peers] [secure] [cyclone] [router] [axe] [viewer]      (default: the first three)
#
# Everything is installed under $MR_DAMPER_INTEROP_DIR (default /var/tmp/mr-damper-interop):
#   jazzy/venv   jazzy/msgs     rclpy and its dependencies from wheels; mr_damper_msgs built against them
#   kilted/venv  kilted/msgs
#   peers/venv                  cyclonedds, eclipse-zenoh, pyzeros, rosbags, mcap, mcap-ros2-support
#   secure/secure_peer          a peer on Debian's Fast DDS, which has DDS-Security; needs libfastrtps-dev and openssl
#   cyclone/secure_cyclone      a peer on Debian's CycloneDDS with DDS-Security; needs cyclonedds-dev, cyclonedds-tools and openssl
#   router/fleet-router         a Zenoh router with a storage; needs Rust, and takes a few minutes to build
#   axe/node_modules            axe-core, which checks the accessibility of the live page; needs npm
#   viewer/node_modules         the Foxglove WebSocket client and the decoder that Lichtblick uses; needs npm
# A part is skipped if its stamp matches these requirements, the interface files, this script and this Python. Delete the directory
# to start over.
#
# Needs: python3 with venv and headers, a C and a C++ compiler. ROS is not needed.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
messages=$(cd "$here/../../msgs" && pwd)
base=${MR_DAMPER_INTEROP_DIR:-/var/tmp/mr-damper-interop}
python=${MR_DAMPER_PYTHON:-python3}

say() { printf 'interop setup: %s\n' "$*" >&2; }
die() {
  say "$*"
  exit 1
}

check_tools() {
  "$python" -c 'import sys; sys.exit(sys.version_info[:2] < (3, 11))' 2>/dev/null ||
    die "$python is not Python 3.11 or newer; install python3 or set MR_DAMPER_PYTHON to another one"
  "$python" -c 'import venv, ensurepip' 2>/dev/null ||
    die "$python cannot make virtual environments; on Debian: apt-get install python3-venv"
  "$python" -c 'import os, sysconfig, sys
sys.exit(not os.path.exists(os.path.join(sysconfig.get_paths()["include"], "Python.h")))' ||
    die "Python.h of $python is missing; on Debian: apt-get install python3-dev"
  command -v c++ >/dev/null || die "the C++ compiler (c++) is missing; on Debian: apt-get install build-essential"
}

# A hash of everything that a part depends on.
fingerprint() {
  local part=$1
  case $part in
    secure)
      cat "$here/secure_peer.cpp" "${BASH_SOURCE[0]}" | sha256sum | cut -d' ' -f1
      return
      ;;
    cyclone)
      cat "$here"/{secure_cyclone.c,mr_damper.idl} "${BASH_SOURCE[0]}" | sha256sum | cut -d' ' -f1
      return
      ;;
    router)
      { rustc --version && cat "$here"/router/{Cargo.toml,Cargo.lock,src/main.rs} "${BASH_SOURCE[0]}"; } | sha256sum | cut -d' ' -f1
      return
      ;;
    axe | viewer)
      cat "$here/$part"/package{,-lock}.json "${BASH_SOURCE[0]}" | sha256sum | cut -d' ' -f1
      return
      ;;
  esac
  {
    "$python" -VV
    cat "$here/requirements/$part.txt" "${BASH_SOURCE[0]}"
    if [ "$part" != peers ]; then
      (cd "$messages" && cat package.xml CMakeLists.txt && find msg srv action -type f | LC_ALL=C sort | xargs cat)
    fi
  } | sha256sum | cut -d' ' -f1
}

install_requirements() {
  local part=$1 venv=$base/$part/venv
  "$python" -m venv "$venv"
  "$venv/bin/pip" install --quiet --disable-pip-version-check -r "$here/requirements/$part.txt" ||
    die "pip could not install requirements/$part.txt; its message above says which package"
}

# CMake files inside the wheels name the Python of the machine that built them. They are changed to name our Python, because CMake
# stops at include directories that do not exist.
relocate_wheels() {
  "$1/bin/python" - "$1/share" <<'PYTHON'
import pathlib, re, sys, sysconfig

paths = sysconfig.get_paths()
include = re.compile(r"/opt/python/cp\d+-cp\d+/include/python3\.\d+")
packages = re.compile(r"/opt/python/cp\d+-cp\d+/lib/python3\.\d+/site-packages")
for file in pathlib.Path(sys.argv[1]).rglob("*.cmake"):
    old = file.read_text(encoding="utf-8", errors="surrogateescape")
    new = include.sub(lambda _: paths["include"], packages.sub(lambda _: paths["purelib"], old))
    if new != old:
        file.write_text(new, encoding="utf-8", errors="surrogateescape")
PYTHON
}

build_messages() {
  local part=$1 venv=$base/$part/venv prefix=$base/$part/msgs site
  site=$("$venv/bin/python" -c 'import sysconfig; print(sysconfig.get_paths()["purelib"])')
  relocate_wheels "$venv"
  if ! env -u _ROS_WHEELS_BOOTSTRAP_COMPLETE PATH="$venv/bin:$PATH" PYTHONPATH="$site" \
    AMENT_PREFIX_PATH="$venv" CMAKE_PREFIX_PATH="$venv" \
    bash -euc '
      cmake -S "$1" -B "$2" -G Ninja -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF \
        -DCMAKE_INSTALL_PREFIX="$3" -DPython3_EXECUTABLE="$4/bin/python"
      cmake --build "$2" --target install
    ' build "$messages" "$base/$part/build" "$prefix" "$venv" >"$base/$part/build.log" 2>&1; then
    tail -n 40 "$base/$part/build.log" >&2
    die "mr_damper_msgs did not build against ROS 2 $part; whole log: $base/$part/build.log"
  fi
}

build_secure_peer() {
  command -v openssl >/dev/null || die "openssl is missing; on Debian: apt-get install openssl"
  [ -e /usr/include/fastdds/dds/domain/DomainParticipant.hpp ] ||
    die "Fast DDS is missing; on Debian: apt-get install libfastrtps-dev"
  c++ -std=c++17 -O1 -o "$base/secure/secure_peer" "$here/secure_peer.cpp" -lfastrtps -lfastcdr ||
    die "secure_peer.cpp did not build; it is written for Fast DDS 2.9"
}

build_cyclone_peer() {
  command -v openssl >/dev/null || die "openssl is missing; on Debian: apt-get install openssl"
  [ -e /usr/include/dds/dds.h ] && command -v idlc >/dev/null ||
    die "CycloneDDS for C is missing; on Debian: apt-get install cyclonedds-dev cyclonedds-tools"
  (cd "$base/cyclone" && idlc -l c "$here/mr_damper.idl" &&
    cc -O1 -I. -o secure_cyclone "$here/secure_cyclone.c" mr_damper.c -lddsc -lm) ||
    die "secure_cyclone.c did not build; it is written for CycloneDDS 0.10"
}

build_router() {
  local target=$base/router/target
  command -v cargo >/dev/null || die "cargo is missing; install Rust"
  cargo build --release --locked --quiet --manifest-path "$here/router/Cargo.toml" --target-dir "$target" ||
    die "the router did not build; the compiler's message is above"
  cp "$target/release/fleet-router" "$base/router/"
  # The build directory takes a gigabyte and is no longer needed.
  rm -rf "$target"
}

# Checks that the part's Python can import what the peers import.
verify() {
  local part=$1
  if [ "$part" = peers ]; then
    "$base/peers/venv/bin/python" -c 'import cyclonedds.domain, zenoh, rosbags, mcap, mcap_ros2' ||
      die "the peers environment does not import; delete $base/peers and run this again"
    # pyzeros compiles a codec at its first use; rmw_peer.py looks for it in this directory.
    CYDR_CACHE_DIR=$base/peers/venv/cydr_cache "$base/peers/venv/bin/python" -c '
from pyzeros.builtin_msgs import Attachment
Attachment().serialize()' || die "pyzeros does not work in $base/peers; its message above gives the cause"
  else
    "$here/ros-python.sh" "$part" -c 'import rclpy; from mr_damper_msgs.msg import ForceEstimate' ||
      die "rclpy with mr_damper_msgs does not import in $part; delete $base/$part and run this again"
  fi
}

install_npm() {
  local part=$1
  command -v npm >/dev/null || die "npm is missing; on Debian: apt-get install npm"
  cp "$here/$part"/package{,-lock}.json "$base/$part/"
  # The lock file has the checksums of the packages.
  npm ci --prefix "$base/$part" --ignore-scripts --no-audit --no-fund --silent ||
    die "npm could not install tests/interop/$part/package.json"
}

prepare() {
  local part=$1 wanted started=$SECONDS
  mkdir -p "$base/$part"
  exec 9>"$base/$part/lock"
  flock 9
  wanted=$(fingerprint "$part")
  if [ "$(cat "$base/$part/stamp" 2>/dev/null)" = "$wanted" ]; then
    say "$part is up to date"
    return
  fi
  say "$part: installing"
  rm -rf "$base/$part/stamp" "$base/$part/venv" "$base/$part/msgs" "$base/$part/build"
  if [ "$part" = secure ]; then
    build_secure_peer
  elif [ "$part" = cyclone ]; then
    build_cyclone_peer
  elif [ "$part" = router ]; then
    build_router
  elif [ "$part" = axe ] || [ "$part" = viewer ]; then
    install_npm "$part"
  else
    install_requirements "$part"
    if [ "$part" != peers ]; then
      say "$part: building mr_damper_msgs"
      build_messages "$part"
    fi
    verify "$part"
  fi
  echo "$wanted" >"$base/$part/stamp"
  say "$part is ready after $((SECONDS - started)) s"
}

check_tools
[ $# -gt 0 ] || set -- jazzy kilted peers
for part in "$@"; do
  case $part in
    jazzy | kilted | peers | secure | cyclone | router | axe | viewer) (prepare "$part") ;;
    *)
      say "unknown part '$part'; parts are jazzy, kilted, peers, secure, cyclone, router, axe, viewer"
      exit 2
      ;;
  esac
done
