# Common start of the scripts in this folder; they source it with their own arguments. Sets `data`, `out` and `mr_damper`.
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

data=${MR_DAMPER_DATA:-../shared/data}
if [ ! -d "$data/utfsm-mr" ]; then
  echo "no runs in $data: set MR_DAMPER_DATA to the folder that contains utfsm-mr, utfpr-mr and nees-mr" >&2
  exit 2
fi
out=${1:-$(mktemp -d "/tmp/mr-damper-$(basename "$0" .sh).XXXXXX")}
mkdir -p "$out"
cargo build --release --quiet --workspace --bins
mr_damper=${CARGO_TARGET_DIR:-target}/release/mr-damper
