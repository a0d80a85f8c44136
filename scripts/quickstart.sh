#!/usr/bin/env bash
# Installs, builds the programs, and makes rigged assets that move of pictures, by the weights that come with the
# repository.
#   scripts/quickstart.sh [--smallest] [--image PATH] [--output FOLDER]
#     --image PATH     picture, or folder of pictures (default: examples/creatures)
#     --smallest       the first of the pictures alone
#     --output FOLDER  where everything goes (default: runs/quickstart)
#   scripts/quickstart.sh --train [--smallest] [--creatures N] [--rigs FOLDER] [--output FOLDER]
#     --train          proves the whole machinery instead: makes creatures, trains all five stages for minutes, makes
#                      assets of pictures of creatures it has never seen, compares them with two baselines, writes a
#                      report. So short a training gives poor assets; experiments/small_models.json trains what ships.
#     --smallest       four minutes instead of fifteen: few creatures, a few steps of each stage
#     --creatures N    procedural creatures to train on (default 240)
#     --rigs FOLDER    rigged GLB/glTF files to add: two thirds are trained on, the rest is evaluated
#     --output FOLDER  where everything goes (default: runs/quickstart_train); again with the same folder what is done
#                      is kept, what was interrupted goes on, and what has other settings or code is made anew
set -euo pipefail
here=$PWD
cd "$(dirname "$0")/.."

refuse() { echo "quickstart: $1" >&2; exit 2; }
train= smallest= image= creatures= output= rigs=
while [ $# -gt 0 ]; do
  case $1 in
    --train) train=yes; shift ;;
    --smallest) smallest=yes; shift ;;
    --image) image=$(cd "$here" && realpath -e -- "$2" 2>/dev/null) || refuse "no such picture: $2"; shift 2 ;;
    --creatures) creatures=$2; shift 2 ;;
    --rigs) rigs=$(cd "$here" && cd "$2" && pwd); shift 2 ;;
    --output) output=$(cd "$here" && realpath -m -- "$2"); shift 2 ;;
    -h|--help) sed -n '2,17s/^# \{0,1\}//p' "$0"; exit 0 ;;
    *) refuse "unknown option '$1'; see --help" ;;
  esac
done
if [ -z "$train" ] && [ -n "$creatures$rigs" ]; then refuse "--creatures and --rigs go with --train"; fi
if [ -n "$train" ] && [ -n "$image" ]; then refuse "--image does not go with --train"; fi

spent() { echo "$(($1 / 60)) min $(($1 % 60)) s"; }
scripts/setup.sh
setup=$SECONDS
scripts/build.sh --programs release
build=$((SECONDS - setup))
bin=build/release/bin

if [ -n "$train" ]; then
  name=quickstart${smallest:+_smallest}
  : "${output:=runs/quickstart_train${smallest:+_smallest}}"
  held_out=$([ -n "$smallest" ] && echo 4 || echo 16)
  changes=()
  [ -z "$creatures" ] || changes+=(--set "steps.dataset.args.--procedural=$((creatures + held_out))")
  [ -z "$rigs" ] || changes+=(--set "steps.dataset.args.--input={path:$rigs}")
  experiment() { $bin/anigen-experiment "$1" "experiments/$name.json" --output "$output" "${changes[@]}" "${@:2}"; }
  experiment run
  assets=$(experiment status --json | grep -o '"folder": ".*/generated-[^"]*' | cut -d '"' -f 4)
  echo "generated assets: $assets/*/mesh.glb, preview.png beside each"
else
  : "${output:=runs/quickstart}" "${image:=examples/creatures}"
  if [ -n "$smallest" ] && [ -d "$image" ]; then image=$(find "$image" -name '*.png' | sort | head -n 1); fi
  $bin/anigen-generate --image "$image" --output "$output"
  for asset in "$output"/*/mesh.glb; do
    $bin/anigen-animate --asset "$asset" --drop-clips --turntable "${asset%mesh.glb}moving.png" --output "${asset%mesh.glb}moving.glb" --quiet
  done
  {
    echo '<!doctype html><meta charset="utf-8"><title>AniGen in C++</title><style>body{font-family:sans-serif}img{max-width:100%}</style>'
    for asset in "$output"/*/mesh.glb; do
      asset=$(basename "$(dirname "$asset")")
      echo "<h2>$asset</h2><p><a href=\"$asset/moving.glb\">$asset/moving.glb</a></p>"
      echo "<img src=\"$asset/preview.png\"><img src=\"$asset/moving.png\">"
    done
  } >"$output/index.html"
  echo "rigged assets that move: $output/*/moving.glb; pictures of all: $output/index.html"
fi
echo "setup $(spent "$setup"), build $(spent "$build"), the rest $(spent $((SECONDS - setup - build)))"
