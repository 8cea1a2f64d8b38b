#!/usr/bin/env bash
# Runs Python with a real ROS 2 and mr_damper_msgs from the environments made by setup.sh.
# usage: ros-python.sh jazzy|kilted ARGUMENTS OF PYTHON...
set -euo pipefail
[ $# -ge 2 ] || {
  echo "usage: ros-python.sh jazzy|kilted SCRIPT [ARGUMENTS...]" >&2
  exit 2
}
distro=$1
shift
root=${MR_DAMPER_INTEROP_DIR:-/var/tmp/mr-damper-interop}/$distro
[ -x "$root/venv/bin/python" ] || {
  echo "ros-python.sh: no ROS 2 $distro in $root; run $(dirname "${BASH_SOURCE[0]}")/setup.sh $distro" >&2
  exit 1
}
packages=$(echo "$root"/msgs/lib/python3.*/site-packages)
# The wheels restart Python once to set up the loader, and record that in an environment variable. A value
# inherited from another environment would prevent the restart.
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE
export ROS_DISTRO=$distro RMW_IMPLEMENTATION=rmw_fastrtps_cpp PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1
export AMENT_PREFIX_PATH=$root/msgs:$root/venv PYTHONPATH=$packages LD_LIBRARY_PATH=$root/msgs/lib:$root/venv/lib
export ROS_LOG_DIR=${ROS_LOG_DIR:-$root/log}
exec "$root/venv/bin/python" "$@"
