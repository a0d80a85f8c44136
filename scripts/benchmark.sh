#!/usr/bin/env bash
# Builds and runs the benchmarks: first what this machine can do at most, then every hot path as a share of it beside a
# named alternative (docs/performance.md). One JSON file a program and all.json, all.md under build/release/benchmarks/.
# Compare only figures of one run: speeds of a shared machine wander.
#   scripts/benchmark.sh [--only WORD] [--published] [--compare OLD.json]
#     --only WORD         programs whose name contains WORD
#     --published         also models of the published size: tens of minutes, up to 11 GB
#     --compare OLD.json  an all.json of before: adds how many times as fast each row is
set -euo pipefail
only='' published='' compare=()
while [ $# -gt 0 ]; do
  case "$1" in
    --only) only="${2:?--only needs a word}"; shift ;;
    --published) published=1 ;;
    --compare) compare=("--compare=$(realpath "${2:?--compare needs a file}")"); shift ;;
    *) sed -n '2,9p' "$0" >&2; exit 2 ;;
  esac
  shift
done
cd "$(dirname "$0")/.."
scripts/build.sh release
folder=build/release/benchmarks
core=$(build/release/bin/anigen-inspect --version | sed -n 's/.*OpenBLAS core \([[:alnum:]]*\)$/\1/p')
[ -z "$core" ] || export OPENBLAS_CORETYPE=$core
files=()
run() {  # NAME [ARGUMENTS]
  local name="$1"; shift
  [[ "$name" == *"$only"* ]] || return 0
  [ -x "$folder/benchmark_$name" ] || { echo "benchmark_$name: not built, left out" >&2; return 0; }
  echo "== $name $*"
  "$folder/benchmark_$name" "$@" --benchmark_out="$folder/$name.json" --benchmark_out_format=json
  files+=("$folder/$name.json")
}
run machine
for name in blocked_attention ragged_attention sparse_convolution volume_convolution flexicubes rasterizer \
  nearest_surface transport vote_clustering voxelize raytrace assets distributed; do
  run "$name"
done
if [ -n "$published" ]; then
  run sparse_structure_flow --blocks=24 --steps=1 --plain-steps=0 --bf16
  run structured_latent_flow --steps=1 --bf16
  run structured_latent_autoencoder --recompute
  run generation --low-memory --steps=3
else
  run sparse_structure_flow --blocks=2 --steps=1
  run structured_latent_flow --blocks=2 --steps=1
fi
[ ${#files[@]} -gt 0 ] || { echo "no benchmark has '$only' in its name" >&2; exit 2; }
"$folder/benchmark_report" "$folder/all.json" "$folder/all.md" "${compare[@]}" "${files[@]}"
