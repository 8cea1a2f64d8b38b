#!/usr/bin/env bash
# A network namespace of its own with nothing but loopback, multicast included.
#
# usage: netns.sh run COMMAND...        runs COMMAND in a new namespace and ends with its exit code
#        netns.sh hold                  makes one, prints its "pid", keeps it until standard input closes
#        netns.sh enter PID COMMAND...  becomes COMMAND (same process id) in the namespace that PID holds
#
# COMMAND under enter dies with the process that started it (SIGKILL), so nothing is left behind when a test
# is killed. Root makes plain namespaces; anybody else gets them inside a user namespace.
set -euo pipefail

die() {
  echo "netns.sh: $*" >&2
  exit 1
}

# Run inside the fresh namespace.
up='ip link set lo up && ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo'

spaces=(--net)
[ "$(id -u)" = 0 ] || spaces+=(--user --map-root-user)
for tool in unshare nsenter setpriv ip; do
  command -v "$tool" >/dev/null || die "$tool is missing; on Debian: apt-get install util-linux iproute2"
done

verb=${1:-}
case $verb in
  run)
    shift
    exec unshare "${spaces[@]}" -- bash -euc "$up"' && exec "$@"' netns "$@"
    ;;
  hold)
    exec unshare "${spaces[@]}" -- bash -euc "$up"' && echo $$ && exec cat >/dev/null'
    ;;
  enter)
    [ $# -ge 3 ] || die "usage: netns.sh enter PID COMMAND..."
    pid=$2
    shift 2
    [ -e "/proc/$pid/ns/net" ] || die "process $pid, which holds the namespace, is gone"
    [ "$(id -u)" = 0 ] || spaces=(--user --preserve-credentials --net)
    exec nsenter --target "$pid" "${spaces[@]}" -- setpriv --pdeathsig KILL "$@"
    ;;
  *) die "usage: netns.sh run COMMAND... | hold | enter PID COMMAND..." ;;
esac
