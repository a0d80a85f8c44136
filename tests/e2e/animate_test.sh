#!/usr/bin/env bash
# anigen-animate as a user runs it: animate_test.sh BIN, the folder of the programs.
set -uo pipefail
bin=$1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
failures=0

fail() {
  echo "$1"
  failures=$((failures + 1))
}

# expect STATUS TEXT PROGRAM ARGUMENT...: the exit status, and TEXT somewhere in what the program prints.
expect() {
  local status=$1 text=$2 program=$3 found=0
  shift 3
  "$bin/$program" "$@" >"$work/said" 2>&1 || found=$?
  [ "$found" = "$status" ] || { fail "exit status $found, expected $status: $program $*"; cat "$work/said"; }
  grep -qF -- "$text" "$work/said" || { fail "no '$text' from: $program $*"; cat "$work/said"; }
}

# A post of two joints, as a text rig, and a clip that bends one of two.
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 0 2 0\nv 1 2 0\nf 1 2 3\nf 2 4 3\nf 3 4 5\nf 4 6 5\n' >"$work/post.obj"
printf 'joints low 0.5 0 0\njoints high 0.5 1 0\nroot low\nhier low high\nskin 0 low 1\nskin 1 low 1\nskin 2 low 0.5 high 0.5\nskin 3 low 0.5 high 0.5\nskin 4 high 1\nskin 5 high 1\n' \
  >"$work/post.txt"
printf 'HIERARCHY\nROOT hip\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\nJOINT foot\n{\nOFFSET 0 -1 0\n}\n}\nMOTION\nFrames: 2\nFrame Time: 1\n0\n90\n' \
  >"$work/turn.bvh"
expect 0 "skinned" anigen-inspect "$work/post.txt" --output "$work/post.glb"

expect 0 "idle" anigen-animate "$work/post.glb" -o "$work/idle.glb"
expect 0 "idle" anigen-inspect "$work/idle.glb"
expect 0 "spin" anigen-animate "$work/post.glb" --list
expect 0 '"motions"' anigen-animate "$work/post.glb" --list --json
expect 0 "a source of clips alone" anigen-animate "$work/turn.bvh" --list
expect 0 '"name": "spin"' anigen-animate "$work/idle.glb" -o "$work/more.glb" --motion spin --motion "$work/turn.bvh" --json
expect 0 "spin" anigen-animate "$work/more.glb" --list
expect 0 "idle" anigen-animate "$work/more.glb" --list
expect 0 "idle" anigen-animate "$work/post.glb" -o "$work/seen.glb" --frames 3 --turntable "$work/seen.png"
expect 0 "kind: picture" anigen-inspect "$work/seen.png"
mkdir -p "$work/in/deep"
cp "$work/post.glb" "$work/in/deep/one.glb"
cp "$work/post.glb" "$work/in/two.glb"
expect 0 "two.glb" anigen-animate "$work/in" -o "$work/out"
[ -f "$work/out/deep/one.glb" ] || fail "a folder gives no folder"
expect 0 "two.fbx" anigen-animate "$work/in" -o "$work/out" --format fbx
[ -f "$work/out/deep/one.fbx" ] || fail "no FBX in a folder"
expect 0 "spin" anigen-animate "$work/idle.glb" -o "$work/moves.fbx" --motion spin
expect 0 "spin" anigen-animate "$work/moves.fbx" --list
expect 0 "idle" anigen-animate "$work/moves.fbx" --list
expect 0 "spin" anigen-animate "$work/moves.fbx" -o "$work/moves.usdz" --motion spin
printf 'broken' >"$work/in/three.glb"
expect 1 "1 of 3 assets were not animated" anigen-animate "$work/in" -o "$work/out"
expect 0 "three.glb" anigen-animate "$work/in" -o "$work/out" --keep-going

# Motions that cannot be done, and bad input.
expect 2 "legs in pairs" anigen-animate "$work/post.glb" -o "$work/none.glb" --motion walk
expect 2 "two arms" anigen-animate "$work/post.glb" -o "$work/none.glb" --pose T
expect 2 "neither a file nor one of" anigen-animate "$work/post.glb" -o "$work/none.glb" --motion gallop
expect 2 "none.bvh" anigen-animate "$work/post.glb" -o "$work/none.glb" --motion "$work/none.bvh"
expect 2 "a rigged asset is a .glb" anigen-animate "$work/post.obj" -o "$work/none.glb"
expect 2 "--output" anigen-animate "$work/post.glb"
expect 2 "post.glb" anigen-animate "$work/post.glb" -o "$work/post.glb"
expect 2 "an animated asset is a .glb" anigen-animate "$work/post.glb" -o "$work/none.stl"
expect 2 "--format" anigen-animate "$work/post.glb" -o "$work/none.fbx" --format fbx
[ ! -e "$work/none.glb" ] || fail "a failed run leaves a file"
exit $((failures > 0))
