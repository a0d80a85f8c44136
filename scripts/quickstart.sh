#!/usr/bin/env bash
# Installs, builds, and runs the whole system on the embedded dataset: makes creatures, trains all five stages, makes
# rigged assets from pictures of creatures it has never seen, compares them with two baselines, writes a report. So much
# training proves that the machinery works, not how good it can be: experiments/tiny_full.json trains longer.
#   scripts/quickstart.sh [--smallest] [--creatures N] [--rigs FOLDER] [--output FOLDER]
#     --smallest       four minutes instead of fifteen: few creatures, a few steps of each stage
#     --creatures N    procedural creatures to train on (default 240)
#     --rigs FOLDER    rigged GLB/glTF files to add: two thirds are trained on, the rest is evaluated
#     --output FOLDER  where everything goes (default runs/quickstart)
# Again with the same --output: what is done is kept, what was interrupted goes on, and what has other settings or code
# is made anew.
set -euo pipefail
here=$PWD
cd "$(dirname "$0")/.."

name=quickstart creatures= output= rigs=
while [ $# -gt 0 ]; do
  case $1 in
    --smallest) name=quickstart_smallest; shift ;;
    --creatures) creatures=$2; shift 2 ;;
    --rigs) rigs=$(cd "$here" && cd "$2" && pwd); shift 2 ;;
    --output) output=$2; shift 2 ;;
    -h|--help) sed -n '2,11s/^# \{0,1\}//p' "$0"; exit 0 ;;
    *) echo "quickstart: unknown option '$1'; see --help" >&2; exit 2 ;;
  esac
done
: "${output:=runs/$name}"
held_out=16
[ $name = quickstart ] || held_out=4

changes=()
[ -z "$creatures" ] || changes+=(--set "steps.dataset.args.--procedural=$((creatures + held_out))")
[ -z "$rigs" ] || changes+=(--set "steps.dataset.args.--input={path:$rigs}")

scripts/setup.sh
scripts/build.sh release
SECONDS=0
experiment() { build/release/bin/anigen-experiment "$1" "experiments/$name.json" --output "$output" "${changes[@]}" "${@:2}"; }
experiment run
assets=$(experiment status --json | grep -o '"folder": ".*/generated-[^"]*' | cut -d '"' -f 4)
echo "generated assets: $assets/*/mesh.glb, preview.png beside each"
echo "$((SECONDS / 60)) min $((SECONDS % 60)) s after the build"
