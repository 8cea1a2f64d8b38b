#!/usr/bin/env bash
# Runs programs in a separate network namespace with only loopback, including multicast.
#
# usage: netns.sh run COMMAND...        runs COMMAND in a new namespace and ends with its exit code
#        netns.sh hold                  makes a namespace, prints its "pid", keeps it until standard input closes
#        netns.sh wire PID PID          connects two held namespaces, 10.77.0.1 and 10.77.0.2, like two hosts (root only)
#        netns.sh route PID PID PID     connects the outer two namespaces to the middle one, a router that carries no multicast:
#                                       10.77.1.2 and 10.77.2.2 (root only)
#        netns.sh enter PID COMMAND...  becomes COMMAND (same process id) in the namespace that PID holds
#
# COMMAND under enter is killed (SIGKILL) with the process that started it, so nothing is left behind when a test is
# killed. Root makes plain namespaces; other users get them inside a user namespace.
set -euo pipefail

die() {
  echo "netns.sh: $*" >&2
  exit 1
}

# Commands that run inside the new namespace.
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
  wire)
    [ $# = 3 ] || die "usage: netns.sh wire PID PID"
    [ "$(id -u)" = 0 ] || die "only root can wire two namespaces"
    ip link add near netns "$2" type veth peer name far netns "$3"
    wired='ip addr add "$2" dev "$1" && ip link set "$1" up && ip route replace 224.0.0.0/4 dev "$1"'
    nsenter --target "$2" --net -- bash -euc "$wired" netns near 10.77.0.1/24
    nsenter --target "$3" --net -- bash -euc "$wired" netns far 10.77.0.2/24
    ;;
  route)
    [ $# = 4 ] || die "usage: netns.sh route PID PID PID"
    [ "$(id -u)" = 0 ] || die "only root can wire namespaces"
    ip link add near netns "$2" type veth peer name near netns "$3"
    ip link add far netns "$4" type veth peer name far netns "$3"
    nsenter --target "$3" --net -- bash -euc 'for side in near:1 far:2; do
      ip addr add "10.77.${side#*:}.1/24" dev "${side%:*}" && ip link set "${side%:*}" up; done
      echo 1 >/proc/sys/net/ipv4/ip_forward'
    leaf='ip addr add "10.77.$2.2/24" dev "$1" && ip link set "$1" up && ip route add default via "10.77.$2.1"
      ip route replace 224.0.0.0/4 dev "$1"'
    nsenter --target "$2" --net -- bash -euc "$leaf" netns near 1
    nsenter --target "$4" --net -- bash -euc "$leaf" netns far 2
    ;;
  enter)
    [ $# -ge 3 ] || die "usage: netns.sh enter PID COMMAND..."
    pid=$2
    shift 2
    [ -e "/proc/$pid/ns/net" ] || die "process $pid, which holds the namespace, is gone"
    [ "$(id -u)" = 0 ] || spaces=(--user --preserve-credentials --net)
    exec nsenter --target "$pid" "${spaces[@]}" -- setpriv --pdeathsig KILL "$@"
    ;;
  *) die "usage: netns.sh run COMMAND... | hold | wire PID PID | route PID PID PID | enter PID COMMAND..." ;;
esac
