#!/usr/bin/env bash
# Installs, builds, and runs the main job on the embedded dataset: make creatures, train SkinAE, reconstruct skin
# weights of creatures and rigs it has never seen, compare with what anyone would try, write a report.
#   scripts/quickstart.sh [--smallest] [--minutes M] [--creatures N] [--rigs FOLDER] [--output FOLDER]
#     --smallest       a minute instead of about ten: few creatures, a short training
#     --minutes M      training time (default 5)
#     --creatures N    procedural creatures to train on (default 600)
#     --rigs FOLDER    rigged GLB/glTF files to add: two thirds are trained on, the rest is evaluated
#     --output FOLDER  where everything goes (default runs/quickstart)
set -euo pipefail
here=$PWD
cd "$(dirname "$0")/.."

minutes=5 creatures=600 held_out=60 output=runs/quickstart rigs=
if [ -d ../shared/assets/rigged ]; then rigs=$PWD/../shared/assets/rigged; fi
while [ $# -gt 0 ]; do
  case $1 in
    --smallest) minutes=0.5 creatures=60 held_out=12 output=runs/quickstart-smallest; shift ;;
    --minutes) minutes=$2; shift 2 ;;
    --creatures) creatures=$2; shift 2 ;;
    --rigs) rigs=$(cd "$here" && cd "$2" && pwd); shift 2 ;;
    --output) output=$2; shift 2 ;;
    -h|--help) sed -n '2,9s/^# \{0,1\}//p' "$0"; exit 0 ;;
    *) echo "quickstart: unknown option '$1'; see --help" >&2; exit 2 ;;
  esac
done

scripts/setup.sh
scripts/build.sh release
bin=build/release/bin
data=$output/dataset run=$output/skin_ae report=$output/report

echo "== 1/3 dataset: $creatures procedural creatures${rigs:+ and the rigs in $rigs}"
"$bin/anigen-prepare" --out "$data" --procedural "$creatures" --procedural-test "$held_out" ${rigs:+--input "$rigs"}

echo "== 2/3 training SkinAE for $minutes minutes (again with the same --output: it resumes)"
"$bin/anigen-train" --config configs/tiny/skin_ae.json --data-dir "$data" --output "$run" --set "trainer.args.max_minutes=$minutes"

echo "== 3/3 evaluation on what was held out"
"$bin/anigen-eval" --gt "$data" --split "$data/splits/test.txt" --skin-ae "$run" --out "$report"
echo "report: $report/report.html"
