#!/bin/sh
# Builds the Debian package from a release build, installs it into an empty root, checks its files, and removes it.
#
# usage: tests/deb/run.sh [BINARY]      BINARY: default target/release/mr-damper
#
# Needs cargo-deb (cargo install cargo-deb --locked) and dpkg. Nothing outside target/ and a temporary directory is written.
set -eu
cd "$(dirname "$0")/../.."
binary=${1:-target/release/mr-damper}
target=${CARGO_TARGET_DIR:-target}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

mkdir -p target/deb "$target/release"
[ "$binary" -ef "$target/release/mr-damper" ] || cp "$binary" "$target/release/mr-damper"
"$binary" --quiet man target/deb/man
for shell in bash zsh fish; do "$binary" completions $shell > target/deb/mr-damper.$shell; done
cargo deb --no-build -p mr-damper-node --output "$work/mr-damper.deb" > "$work/log" 2>&1 || { cat "$work/log" >&2; exit 1; }

root=$work/root
mkdir -p "$root/var/lib/dpkg/info" "$root/var/lib/dpkg/updates"
: > "$root/var/lib/dpkg/status"
: > "$root/var/lib/dpkg/available"
# The empty root has no libc6, so dependencies are not checked.
dpkg --root="$root" --force-depends --force-not-root --force-script-chrootless -i "$work/mr-damper.deb" > "$work/log" 2>&1 \
  || { cat "$work/log" >&2; exit 1; }
for file in bin/mr-damper lib/systemd/system/mr-damper@.service share/doc/mr-damper/damper.params.yaml \
    share/man/man1/mr-damper.1.gz share/man/man1/mr-damper-node.1.gz share/bash-completion/completions/mr-damper \
    share/zsh/vendor-completions/_mr-damper share/fish/vendor_completions.d/mr-damper.fish; do
  [ -e "$root/usr/$file" ] || { echo "the package lacks /usr/$file" >&2; exit 1; }
done
"$root/usr/bin/mr-damper" --version
dpkg --root="$root" --force-depends --force-not-root -r mr-damper > "$work/log" 2>&1 || { cat "$work/log" >&2; exit 1; }
# dpkg also removes directories that are empty then.
left=$([ ! -d "$root/usr" ] || find "$root/usr" -type f)
[ -z "$left" ] || { echo "left behind: $left" >&2; exit 1; }
echo "the package was built, installed and removed"
