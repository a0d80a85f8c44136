#!/bin/bash
# Procedural creatures as VRM, loaded by three.js where it is installed: vrm_test.sh FOLDER_OF_PROGRAMS SOURCE
# Humanoids among them become .vrm files, the others are refused by the bones that they lack.
set -euo pipefail
programs=$1 source=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() {
  echo "FAILED: $1" >&2
  exit 1
}

"$programs/anigen-prepare" --procedural 16 --procedural-test 0 --only import --only asset --output "$work/data" --quiet >/dev/null
made=()
for asset in "$work"/data/assets/*.glb; do
  name=$(basename "${asset%.glb}")
  if "$programs/anigen-rig" "$asset" --method nearest --height 1.7 --ground --output "$work/$name.vrm" --quiet >"$work/log" 2>&1; then
    made+=("$work/$name.vrm")
    "$programs/anigen-inspect" "$work/$name.vrm" >/dev/null || fail "anigen-inspect does not read $name.vrm"
  else
    grep -q "no joint was found for: .*leftUpperArm\|no joint was found for: .*hips\|no joint was found for: .*head" "$work/log" ||
      fail "refused without a bone: $(cat "$work/log")"
    [ ! -e "$work/$name.vrm" ] || fail "a refused mesh left $name.vrm"
  fi
done
[ ${#made[@]} -ge 3 ] || fail "only ${#made[@]} of 16 creatures are humanoids"
command -v node >/dev/null || exit 77
node "$source/scripts/validate_vrm.mjs" "${made[@]}"
