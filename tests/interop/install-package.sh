#!/usr/bin/env bash
# Installs the ROS package mr_damper like colcon: with CMake and the ament of an environment made by setup.sh.
# usage: install-package.sh jazzy|kilted BUILD PREFIX BINARY
set -euo pipefail
[ $# = 4 ] || {
  echo "usage: install-package.sh jazzy|kilted BUILD PREFIX BINARY" >&2
  exit 2
}
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
venv=${MR_DAMPER_INTEROP_DIR:-/var/tmp/mr-damper-interop}/$1/venv
site=$(echo "$venv"/lib/python3.*/site-packages)
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE
export PATH=$venv/bin:$PATH PYTHONPATH=$site AMENT_PREFIX_PATH=$venv CMAKE_PREFIX_PATH=$venv
cmake -S "$here/../../launch-configs" -B "$2" -G Ninja -DBUILD_TESTING=OFF -DCMAKE_INSTALL_PREFIX="$3" \
  -DPython3_EXECUTABLE="$venv/bin/python" -DMR_DAMPER_BINARY="$4" >&2
cmake --build "$2" --target install >&2
