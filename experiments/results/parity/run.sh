#!/usr/bin/env bash
# Runs every parity fixture of a folder and writes results.csv, a row per compared output, and table.md beside this file.
#   run.sh PARITY_RUNNER FOLDER
set -euo pipefail
runner=$(realpath "$1") folder=$(realpath "$2")
cd "$(dirname "$0")"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
for file in "$folder"/*.json "$folder"/state_dict_spec/*.json; do
  name=${file#"$folder"/}
  name=${name%.json}
  status=0
  ANIGEN_PARITY_DIR=$folder "$runner" "${name/\//.}" >"$log.one" 2>&1 || status=$?
  echo "== ${name/\//.} $status" >>"$log"
  cat "$log.one" >>"$log"
done
rm -f "$log.one"

awk '
  BEGIN { print "fixture,output,passed,max_error,percent_of_limit" }
  $1 == "==" { name = $2; if ($3 == 77) print name ",,skipped,,"; else if ($3 != 0) print name ",,failed,,"; next }
  $1 != "ok" && $1 != "FAIL" { next }
  { passed = $1 == "ok" ? "yes" : "no"; line = $0; sub(/^(ok|FAIL) +/, "", line); error = share = "" }
  match(line, / +max error .*% of the limit.*/) {
    split(substr(line, RSTART), part, / +/)
    for (i in part) { if (part[i] == "error") error = part[i + 1]; if (part[i] ~ /%$/) share = part[i] }
    sub(/%/, "", share)
    line = substr(line, 1, RSTART - 1)
  }
  { if (sub(/ +exact *$/, "", line)) share = "exact"; gsub(/[",]/, ";", line); print name "," line "," passed "," error "," share }
' "$log" >results.csv

awk -F , '
  BEGIN {
    count = split("skin_ae|SkinAE;ss_|sparse structure: auto-encoder, flow;slat_|structured latents: auto-encoder, flow;mesh_|surface extraction;" \
      "grouping|clustering of votes;sampler_|samplers;train_|objectives of both flows;ckpt_|choice of checkpoint files;e2e|picture to rig, whole;" \
      "state_dict_spec|keys, shapes and types of state dicts;ops_anymate|Anymate;ops_data|data;ops_dense|dense layers;ops_embed|embeddings;" \
      "ops_window|window attention;ops_dinov2|DINOv2;ops_loss|losses;ops_metric|metrics;ops_ot|optimal transport;ops_raster|rasteriser;" \
      "ops_sparse|sparse layers;ops_train|training loop", families, ";")
    for (i = 1; i <= count; ++i) { split(families[i], pair, "|"); prefix[i] = pair[1]; title[i] = pair[2] }
  }
  NR == 1 { next }
  {
    if (!($1 in family)) {
      for (i = 1; i <= count; ++i) if (index($1, prefix[i]) == 1) break
      family[$1] = i; names[++n] = $1; ++fixtures[i]
    }
    i = family[$1]
    if ($3 == "skipped") { ++skipped[i]; state[$1] = "skipped"; next }
    if ($3 != "yes") state[$1] = "FAILED"
    if ($2 == "") next
    ++outputs[i]; ++compared[$1]
    if (share[$1] == "" || $5 + 0 > share[$1] + 0) share[$1] = $5
    if (worst[i] == "" || $5 + 0 > worst[i] + 0) worst[i] = $5
  }
  END {
    print "| part | fixtures | skipped | compared | largest error, % of its limit |\n|---|--:|--:|--:|--:|"
    for (i = 1; i <= count; ++i) if (fixtures[i])
      printf "| %s (`%s…`) | %d | %d | %d | %s |\n", title[i], prefix[i], fixtures[i], skipped[i], outputs[i], worst[i]
    print "\n| fixture | result | compared | largest error, % of its limit |\n|---|---|--:|--:|"
    for (k = 1; k <= n; ++k)
      printf "| `%s` | %s | %d | %s |\n", names[k], names[k] in state ? state[names[k]] : "passed", compared[names[k]], share[names[k]]
  }
' results.csv >table.md
