#!/usr/bin/env bash
# Installs, builds, and runs the whole system on the embedded dataset: makes creatures, trains all five stages, makes
# rigged assets from pictures of creatures it has never seen, compares them with two baselines, writes reports. So much
# training proves that the machinery works, not how good it can be.
#   scripts/quickstart.sh [--smallest] [--length F] [--creatures N] [--rigs FOLDER] [--output FOLDER]
#     --smallest       four minutes instead of fifteen: few creatures, a few steps of each stage
#     --length F       F times as many training steps (default 1)
#     --creatures N    procedural creatures to train on (default 240)
#     --rigs FOLDER    rigged GLB/glTF files to add: two thirds are trained on, the rest is evaluated
#     --output FOLDER  where everything goes (default runs/quickstart)
# Again with the same --output: what is done is kept, and an interrupted training resumes.
set -euo pipefail
here=$PWD
cd "$(dirname "$0")/.."

smallest= length=1 creatures= output= rigs=
while [ $# -gt 0 ]; do
  case $1 in
    --smallest) smallest=yes; shift ;;
    --length) length=$2; shift 2 ;;
    --creatures) creatures=$2; shift 2 ;;
    --rigs) rigs=$(cd "$here" && cd "$2" && pwd); shift 2 ;;
    --output) output=$2; shift 2 ;;
    -h|--help) sed -n '2,11s/^# \{0,1\}//p' "$0"; exit 0 ;;
    *) echo "quickstart: unknown option '$1'; see --help" >&2; exit 2 ;;
  esac
done

if [ -n "$smallest" ]; then
  : "${creatures:=24}" "${output:=runs/quickstart-smallest}"
  held_out=4 pictures=2 samples=0 steps=(60 40 6 120 6)
else
  : "${creatures:=240}" "${output:=runs/quickstart}"
  held_out=16 pictures=6 samples=1 steps=(400 150 90 220 70)  # of the five stages
fi

# What a training has seen must stay what it was: other assets would make another test split.
settings="creatures $creatures, rigs ${rigs:-none}, length $length"
mkdir -p "$output"
if [ -f "$output/settings.txt" ] && [ "$(cat "$output/settings.txt")" != "$settings" ]; then
  echo "quickstart: $output holds a run with $(cat "$output/settings.txt"); name another --output, or remove it" >&2
  exit 2
fi
echo "$settings" > "$output/settings.txt"

scripts/setup.sh
scripts/build.sh release
bin=build/release/bin data=$output/dataset runs=$output/runs
step() { echo "== $1 ($((SECONDS / 60)) min $((SECONDS % 60)) s)"; }
SECONDS=0

# train STAGE CONFIG [--set …]: the number of steps is the config's schedule, so it is shortened as a whole. Averages of
# weights must forget their random start within so few steps: the configs' own rates average over hundreds.
train() {
  local stage=$1 config=$2
  shift 2
  local count
  count=$(awk -v n="${steps[$((stage - 1))]}" -v f="$length" 'BEGIN { n = int(n * f); print n < 2 ? 2 : n }')
  "$bin/anigen-train" --config "configs/$config.json" --data-dir "$data" --output "$runs/$(basename "$config")" \
    --set "trainer.args.max_steps=$count" --set "trainer.args.i_eval=$count" --set "trainer.args.i_save=$count" \
    --set "trainer.args.i_sample=$((samples * count))" --set "trainer.args.ema_rate=[0.9]" "$@"
}

step "1/9 dataset: $creatures procedural creatures${rigs:+ and the rigs in $rigs}"
"$bin/anigen-prepare" --out "$data" --procedural $((creatures + held_out)) --procedural-test "$held_out" ${rigs:+--input "$rigs"} \
  --views 12 --view-size 128 --cond-views 4 --cond-view-size 256 --cond-cameras front --features surface

step "2/9 stage 1: skin weights (SkinAE)"
train 1 tiny/skin_ae
"$bin/anigen-eval" --gt "$data" --split "$data/splits/test.txt" --skin-ae "$runs/skin_ae" --out "$output/report_skin"

step "3/9 stage 2: sparse structure, auto-encoder"
train 2 tiny32/ss_dae
"$bin/anigen-encode" ss --run "$runs/ss_dae" --data "$data"

step "4/9 stage 4: from a picture to the sparse structure"
train 4 tiny32/ss_flow --set "dataset.args.ss_dec_path=$runs/ss_dae"

step "5/9 stage 3: structured latents, auto-encoder"
train 3 tiny32/slat_dae --set "trainer.args.skin_ae_run=$runs/skin_ae"
"$bin/anigen-encode" slat --run "$runs/slat_dae" --data "$data"

step "6/9 stage 5: from a picture to the structured latents"
train 5 tiny32/slat_flow --set "dataset.args.slat_dec_path=$runs/slat_dae"

step "7/9 rigged assets from pictures of creatures that no training saw"
rm -rf "$output/pictures"
mkdir -p "$output/pictures"
awk -v n="$pictures" '!/^#/ && NF && c++ < n' "$data/splits/test.txt" | while read -r id; do
  [ ! -f "$data/renders_cond/$id/000.png" ] || cp "$data/renders_cond/$id/000.png" "$output/pictures/$id.png"
done
# So little training may leave a picture without an asset, which is no reason to stop.
"$bin/anigen-generate" --image "$output/pictures" --checkpoint "$runs" --output "$output/generated" --hidden-views 50 || true
if ! ls "$output"/generated/*/mesh.glb > /dev/null 2>&1; then
  echo "quickstart: no picture gave an asset; train longer (--length 3)" >&2
  exit 1
fi

step "8/9 baselines"
"$bin/anigen-rig" --method retrieval --image "$output/pictures" --dataset "$data" --split "$data/splits/train.txt" \
  --out "$output/retrieved"
"$bin/anigen-rig" --method template --mesh "$output/generated" --dataset "$data" --split "$data/splits/train.txt" \
  --out "$output/template"

step "9/9 evaluation"
ls "$output/pictures" | sed 's/\.png$//' > "$output/pictured.txt"
"$bin/anigen-eval" --pred ours="$output/generated" --pred retrieval="$output/retrieved" --pred template="$output/template" \
  --gt "$data" --split "$output/pictured.txt" --out "$output/report"

step "done"
echo "generated assets:   $output/generated/*/mesh.glb, preview.png beside each"
echo "report:             $output/report/report.html"
echo "skin weights alone: $output/report_skin/report.html"
