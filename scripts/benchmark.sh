#!/usr/bin/env bash
# Builds and runs the benchmarks: first what this machine can do at most, then every hot path as a share of it beside a
# named alternative (docs/performance.md). One JSON file a program and all.json, all.md under build/release/benchmarks/.
# Compare only figures of one run: speeds of a shared machine wander.
#   scripts/benchmark.sh [--only WORD] [--published] [--compare OLD.json | --against BUILD [--turns N]]
#     --only WORD         programs whose name contains WORD
#     --published         also models of the published size: tens of minutes, up to 11 GB
#     --compare OLD.json  an all.json of before: adds how many times as fast each row is
#     --against BUILD     a build folder of another version, whose programs run in turn with these: all in one run
#     --turns N           how often, with --against [3]
set -euo pipefail
only='' published='' compare=() against='' turns=''
while [ $# -gt 0 ]; do
  case "$1" in
    --only) only="${2:?--only needs a word}"; shift ;;
    --published) published=1 ;;
    --compare) compare=("--compare=$(realpath "${2:?--compare needs a file}")"); shift ;;
    --against) against="$(realpath "${2:?--against needs a build folder}")"; shift ;;
    --turns) turns="${2:?--turns needs a number}"; shift ;;
    *) sed -n '2,10p' "$0" >&2; exit 2 ;;
  esac
  shift
done
usage() { echo "$1" >&2; exit 2; }
[ -z "$against" ] || [ ${#compare[@]} -eq 0 ] || usage "--compare or --against, not both"
[ -n "$against" ] || [ -z "$turns" ] || usage "--turns goes with --against"
[[ "${turns:=3}" =~ ^[1-9][0-9]?$ ]] || usage "--turns needs a number from 1 to 99"
[ -z "$against" ] || [ -d "$against/benchmarks" ] || usage "$against holds no benchmarks"
cd "$(dirname "$0")/.."
scripts/build.sh release
folder=build/release/benchmarks
# What programs and newer benchmarks choose for themselves: OpenBLAS's kernels, and memory that is kept.
core=$(build/release/bin/anigen-inspect --version | sed -n 's/.*OpenBLAS core \([[:alnum:]]*\)$/\1/p')
[ -z "$core" ] || export OPENBLAS_CORETYPE=$core
export MALLOC_ARENA_MAX=1 MALLOC_MMAP_THRESHOLD_=268435456 MALLOC_TRIM_THRESHOLD_=2147483647
files=()
run() {  # NAME [ARGUMENTS]
  local name="$1"; shift
  [[ "$name" == *"$only"* ]] || return 0
  [ -x "$folder/benchmark_$name" ] || { echo "benchmark_$name: not built, left out" >&2; return 0; }
  if [ -z "$against" ]; then
    echo "== $name $*"
    "$folder/benchmark_$name" "$@" --benchmark_out="$folder/$name.json" --benchmark_out_format=json
    files+=("$folder/$name.json")
    return
  fi
  local turn side out old="$against/benchmarks/benchmark_$name" before=()
  [ -x "$old" ] || echo "benchmark_$name: $against does not have it, nothing to compare with" >&2
  for ((turn = 1; turn <= turns; ++turn)); do
    # The first to run changes from turn to turn, so that a machine that gets slower favours neither.
    for side in $([ $((turn % 2)) = 1 ] && echo before now || echo now before); do
      echo "== $name $*, turn $turn, $side"
      if [ "$side" = now ]; then
        out="$folder/$name.$turn.json"
        "$folder/benchmark_$name" "$@" --benchmark_out="$out" --benchmark_out_format=json
        files+=("$out")
      elif [ -x "$old" ]; then
        out="$folder/$name.before.$turn.json"
        if "$old" "$@" --benchmark_out="$out" --benchmark_out_format=json; then
          before+=("--compare=$out")
        else
          echo "benchmark_$name: that of $against failed, nothing to compare with" >&2
          old=''
        fi
      fi
    done
  done
  [ -z "$old" ] || compare+=("${before[@]}")
}
run machine
for name in linear blocked_attention ragged_attention sparse_convolution volume_convolution flexicubes rasterizer \
  nearest_surface transport vote_clustering voxelize raytrace assets distributed; do
  run "$name"
done
if [ -n "$published" ]; then
  run sparse_structure_flow --blocks=24 --steps=1 --plain-steps=0 --bf16
  run structured_latent_flow --steps=1 --bf16
  run structured_latent_autoencoder --recompute
  run generation --low-memory --steps=3
else
  # The first step of a program also fetches its memory from the system.
  run sparse_structure_flow --blocks=2 --steps=3
  run structured_latent_flow --blocks=2 --steps=3
fi
[ ${#files[@]} -gt 0 ] || { echo "no benchmark has '$only' in its name" >&2; exit 2; }
"$folder/benchmark_report" "$folder/all.json" "$folder/all.md" "${compare[@]}" "${files[@]}"
