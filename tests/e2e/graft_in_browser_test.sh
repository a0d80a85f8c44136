#!/usr/bin/env bash
# New weights leave what three.js shows of a file as it was, and another mesh does not: scripts/compare_in_browser.mjs.
#   graft_in_browser_test.sh BIN SOURCE
# Exit status 77, skipped, without Chromium, node or three.js.
set -euo pipefail
bin=$1 source=$2
command -v node >/dev/null || exit 77
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# A post of two joints, as a text rig.
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 0 2 0\nv 1 2 0\nf 1 2 3\nf 2 4 3\nf 3 4 5\nf 4 6 5\n' >"$work/post.obj"
printf 'joints low 0.5 0 0\njoints high 0.5 1 0\nroot low\nhier low high\nskin 0 low 1\nskin 1 low 1\nskin 2 low 0.5 high 0.5\nskin 3 low 0.5 high 0.5\nskin 4 high 1\nskin 5 high 1\n' \
  >"$work/post.txt"
"$bin/anigen-inspect" -q "$work/post.txt" --output "$work/post.glb"
"$bin/anigen-rig" -q --method heat --mesh "$work/post.glb" --output "$work/bound.glb"
sed 's/^v 1 2 0/v 2 2 0/' "$work/post.obj" >"$work/leaning.obj"
cp "$work/post.txt" "$work/leaning.txt"
"$bin/anigen-inspect" -q "$work/leaning.txt" --output "$work/leaning.glb"

status=0
node "$source/scripts/compare_in_browser.mjs" "$work/post.glb" "$work/bound.glb" >"$work/same.json" || status=$?
[ "$status" != 77 ] || exit 77
cat "$work/same.json"
[ "$status" = 0 ] || { echo "grafting changed the picture"; exit 1; }
grep -q '"surface":0\.[0-9]*[1-9]' "$work/same.json" || { echo "the picture is empty"; exit 1; }
if node "$source/scripts/compare_in_browser.mjs" "$work/post.glb" "$work/leaning.glb"; then
  echo "another mesh is taken for the first"
  exit 1
fi
