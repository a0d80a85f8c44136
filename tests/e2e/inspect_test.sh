#!/usr/bin/env bash
# anigen-inspect as a user runs it.
#   inspect_test.sh PROGRAM          files made up here: kinds, pictures, exports, exit statuses
#   inspect_test.sh PROGRAM FOLDER   every model below FOLDER in a format that the project reads: each is described or
#                                    rejected, none crashes the program or holds it up; exit status 77 where the folder is
#                                    missing
set -uo pipefail
program=$1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
failures=0

fail() {
  echo "$1"
  failures=$((failures + 1))
}

if [ $# -eq 2 ]; then
  if [ ! -d "$2" ]; then
    echo "skipped: $2 is not there (Debian's package assimp-testmodels)"
    exit 77
  fi
  mapfile -d '' -t files < <(find "$2" -type f -regextype egrep -iregex '.*\.(glb|gltf|fbx|dae|obj|ply|stl|bvh)' -print0 | sort -z)
  [ ${#files[@]} -gt 0 ] || fail "no model below $2"
  timeout 500 "$program" --json --keep-going "${files[@]}" >"$work/said" 2>"$work/errors"
  status=$?
  [ $status = 0 ] || { fail "exit status $status"; tail -n 5 "$work/errors"; }
  described=$(grep -c '^    "kind":' "$work/said")
  rejected=$(grep -c '^    "rejected":' "$work/said")
  echo "${#files[@]} models: $described described, $rejected rejected"
  [ $((described + rejected)) = ${#files[@]} ] || fail "not every file is accounted for"
  # Many are broken on purpose; more would mean that a reader has lost a format.
  [ $((3 * described)) -ge $((2 * ${#files[@]})) ] || fail "more than a third is rejected"
  ! grep -E 'rejected.*(crashed|processor time|within|by the system)' "$work/said" || fail "a reader crashed or hung"
  exit $((failures > 0))
fi

# expect STATUS TEXT ARGUMENT...: the exit status, and TEXT somewhere in what the program prints.
expect() {
  local status=$1 text=$2 found=0
  shift 2
  "$program" "$@" >"$work/said" 2>&1 || found=$?
  [ "$found" = "$status" ] || { fail "exit status $found, expected $status: $*"; cat "$work/said"; }
  grep -qF -- "$text" "$work/said" || { fail "no '$text' from: $*"; cat "$work/said"; }
}

printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n' >"$work/flat.obj"
printf 'v 0 0 zero\n' >"$work/broken.obj"
printf 'HIERARCHY\nROOT hip\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\nJOINT foot\n{\nOFFSET 0 -1 0\n}\n}\nMOTION\nFrames: 2\nFrame Time: 1\n0\n90\n' \
  >"$work/turn.bvh"
expect 0 "none: a mesh, no rig" "$work/flat.obj"
expect 0 '"kind": "motion"' "$work/turn.bvh" --json
expect 0 "kind: mesh" "$work/flat.obj" --output "$work/flat.png" --output "$work/flat.glb"
expect 0 "kind: mesh" "$work/flat.glb"
expect 0 "kind: motion" "$work/turn.bvh" --output "$work/turn.png" --output "$work/turn.glb"
expect 0 "a skeleton with motion, no mesh" "$work/turn.glb"
expect 0 "kind: picture" "$work/flat.png"
expect 0 "| motion" "$work/flat.obj" "$work/turn.bvh"
expect 0 "kind: folder" "$work"
expect 2 "broken.obj: line 1: " "$work/broken.obj"
sed 's/hip/h\xff/' "$work/turn.bvh" >"$work/bytes.bvh"
printf 'v 0 0 \xff\n' >"$work/bytes.obj"
expect 0 '"kind": "motion"' "$work/bytes.bvh" --json
expect 2 '"rejected": ' "$work/bytes.obj" --json
expect 1 "1 of 2 files rejected" "$work/flat.obj" "$work/broken.obj"
expect 0 "rejected: $work/broken.obj: line 1: " "$work/flat.obj" "$work/broken.obj" --keep-going
expect 2 "needs skin weights" "$work/flat.obj" --influence-loss
expect 2 "need a file with a mesh or a skeleton" "$work/flat.png" --output "$work/other.png"
expect 2 "no such file" "$work/none.glb"
# Lint: 0 without findings of the level, 1 with, 2 for what cannot be read.
cp "$work/flat.obj" "$work/arm.obj"
printf 'joints a 0 0 0\njoints b 1 0 0\nroot a\nhier a b\nskin 0 a 1\nskin 1 b 1\nskin 2 a 1\n' >"$work/arm.txt"
expect 0 "arm.txt: no errors, no warnings" "$work/arm.txt" --lint --lint-level warning
expect 0 '"findings": ' "$work/arm.txt" --lint --json
expect 1 "no-weights" "$work/flat.obj" --lint
expect 1 "1 of 2 rigs have findings of level error" "$work/arm.txt" "$work/flat.obj" --lint
expect 2 "no such file" "$work/none.glb" --lint
expect 2 "--lint needs a rig" "$work/flat.png" --lint
exit $((failures > 0))
