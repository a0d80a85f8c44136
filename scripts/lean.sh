#!/usr/bin/env bash
# Proves the lean build on a bare Debian 12: installs what `scripts/setup.sh --lean` names and nothing else, builds,
# runs the smallest experiment (data, all five trainings, generation, evaluation), and makes an asset of an image by the
# weights that ship. Says how long each took, how large the programs are and what they link. Needs root; the folder is
# kept, so that a second run only rebuilds.
#   scripts/lean.sh [FOLDER]     default /var/tmp/anigen-lean
set -euo pipefail
cd "$(dirname "$0")/.."
root=${1:-/var/tmp/anigen-lean}
. scripts/bare_debian.sh

here() { inside "$root" "cd /project; $1"; }
timed() { local start=$SECONDS; "${@:2}"; echo "lean: $1: $((SECONDS - start)) s"; }

enter bookworm "$root"
# Files that git no longer knows go from the copy.
mkdir -p "$root/project" "$root/root/.ccache"
find "$root/project" -mindepth 1 -maxdepth 1 ! -name build -exec rm -rf {} +
copy_checkout "$root/project"

timed "packages" here 'apt-get update -qq; scripts/setup.sh --lean'
timed "build" here 'scripts/build.sh lean >/tmp/build.log 2>&1 || { tail -n 40 /tmp/build.log; exit 1; }'
echo "lean: $(here 'du -chL build/lean/bin/* build/lean/lib/anigen/anigen-torch.so | tail -n 1 | cut -f 1') of programs with their module"
echo "lean: shared libraries that they name:" $(here 'readelf -d build/lean/bin/* build/lean/lib/anigen/anigen-torch.so' | grep -o 'NEEDED.*\[[^]]*' | sed 's/.*\[//' | sort -u)

# --- The whole machinery at its smallest, then one image by the weights that ship ---
here 'rm -rf runs'
timed "data, five trainings, generation, evaluation" here 'build/lean/bin/anigen-experiment run experiments/quickstart_smallest.json --output runs/smallest --quiet'
timed "an image to a rigged GLB" here 'build/lean/bin/anigen-generate --image "$(find examples/creatures -name "*.png" | sort | head -n 1)" --output runs/image --quiet'
here 'ls -l runs/image/*/mesh.glb'
