#!/usr/bin/env bash
# The weights that ship make rigged assets of images of creatures that no training saw, by the commands of a user without
# any option; two of the quickstart's pictures become assets that are sound and move.
#   shipped_assets_test.sh BIN SOURCE
set -euo pipefail
bin=$1 source=$2
export ANIGEN_WEIGHTS=$source/weights/anigen-small
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

mkdir "$folder/pictures"
cp "$source/examples/creatures/bird.png" "$source/examples/creatures/person.png" "$folder/pictures"
"$bin/anigen-generate" -q --image "$folder/pictures" --output "$folder/examples"
for name in bird person; do
  "$bin/anigen-inspect" --json "$folder/examples/$name/mesh.glb" >"$folder/$name.json"
done

# One image goes into one file by its name, several do not.
"$bin/anigen-generate" -q "$folder/pictures/bird.png" --output "$folder/bird.fbx"
"$bin/anigen-inspect" --json "$folder/bird.fbx" >"$folder/file.json"
grep -q '"joints"' "$folder/file.json"
if "$bin/anigen-generate" -q --image "$folder/pictures" --output "$folder/both.glb" 2>"$folder/refused"; then exit 1; fi
grep -q "a file holds one asset" "$folder/refused"

"$bin/anigen-prepare" -q --output "$folder/data" --procedural 4 --procedural-test 4 --seed 900000200 --views 1 --view-size 32 \
  --cond-views 1 --cond-view-size 128 --cond-cameras front
"$bin/anigen-generate" -q -d "$folder/data" --split "$folder/data/splits/test.txt" --output "$folder/generated"
"$bin/anigen-eval" -q --pred ours="$folder/generated" -d "$folder/data" --split "$folder/data/splits/test.txt" \
  --metrics skeleton,surface --output "$folder/results" --no-report

python3 - "$folder" <<'PYTHON'
import json, sys
folder = sys.argv[1]
for name in ("bird", "person"):
    described = json.load(open(f"{folder}/{name}.json"))
    print(name, described["joints"], "joints,", described["faces"], "faces")
    assert 8 <= described["joints"] <= 80, described
    assert described["faces"] > 1000 and described["images"] >= 1, described
    assert [clip["name"] for clip in described["animations"]] == ["idle"], described
means = {key: value["mean"] for key, value in json.load(open(f"{folder}/results/metrics.json"))["summary"].items()}
print({key: means[key] for key in ("j2j", "surface_chamfer", "fscore")})
assert means["j2j"] < 0.09 and means["surface_chamfer"] < 0.04 and means["fscore"] > 0.75, means
PYTHON
