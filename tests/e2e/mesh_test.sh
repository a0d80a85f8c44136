#!/usr/bin/env bash
# anigen-mesh as a user runs it, on files with defects made up here.
#   mesh_test.sh ANIGEN_MESH ANIGEN_INSPECT
set -uo pipefail
program=$1 inspect=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 1
failures=0

fail() {
  echo "$1"
  failures=$((failures + 1))
}

# expect STATUS TEXT ARGUMENT...: the exit status, and TEXT somewhere in what the program prints.
expect() {
  local status=$1 text=$2 found=0
  shift 2
  "$program" "$@" >said 2>&1 || found=$?
  [ "$found" = "$status" ] || { fail "exit status $found, expected $status: $*"; cat said; }
  grep -qF -- "$text" said || { fail "no '$text' from: $*"; cat said; }
}

# A cube of separate triangles, one of them turned over, one side open.
cube() {
  local n=1
  for face in "0 0 0  0 1 0  1 1 0" "0 0 0  1 1 0  1 0 0" "0 0 1  1 0 1  1 1 1" "0 0 1  1 1 1  0 1 1" \
    "0 0 0  1 0 0  1 0 1" "0 0 0  0 0 1  1 0 1" "0 1 0  0 1 1  1 1 1" "0 1 0  1 1 1  1 1 0" \
    "0 0 0  0 0 1  0 1 1" "0 0 0  0 1 1  0 1 0"; do
    read -ra x <<<"$face"
    printf 'v %s %s %s\nv %s %s %s\nv %s %s %s\nf %d %d %d\n' "${x[@]}" $n $((n + 1)) $((n + 2))
    n=$((n + 3))
  done
}
cube >cube.obj
printf 'joints a 0 0 0\njoints b 0 1 0\nroot a\nhier a b\n' >cube.txt
for v in $(seq 0 29); do echo "skin $v a 1"; done >>cube.txt
printf 'v 0 0 zero\n' >broken.obj
printf 'v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n' >nan.obj
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n' >one.obj

expect 1 "edges between faces of opposite orientation" check cube.obj
expect 0 "sound; open, 1 part, 1 border" check one.obj
expect 1 "3 border edges" check one.obj --solid
expect 0 '"closed": false' check one.obj --json
expect 1 "1 of 2 meshes have findings" check one.obj cube.obj
expect 2 "broken.obj: line 1: " check broken.obj
expect 2 "nan.obj" check nan.obj
expect 2 "1 of 2 files cannot be read" check one.obj broken.obj
expect 0 "one.obj: sound" check one.obj broken.obj --keep-going
expect 2 "no such file" check none.glb
expect 2 "expected .glb" repair cube.obj -o cube.fbx
expect 2 "cube.obj" repair cube.obj -o cube.obj

# The rig comes along, and goes with a warning where the format has none.
expect 0 "filled_holes: 1" repair cube.txt -o sound.glb --fill-holes 4
expect 0 "sound; closed, 1 part" check sound.glb --solid
"$inspect" sound.glb | grep -q "kind: asset" || fail "the repaired cube has lost its rig"
expect 0 "not kept: the rig" repair cube.txt -o flat.stl
expect 0 "sound; open, 1 part" check flat.stl
for format in glb obj ply stl; do
  expect 0 "joints: 2" remesh sound.glb -o "even.$format" --edge-length 0.1
  expect 0 "sound; closed, 1 part" check "even.$format" --solid
done
"$inspect" even.glb | grep -q "kind: asset" || fail "the remeshed cube has lost its rig"
expect 0 "faces: 12" simplify even.glb -o twelve.glb --faces 12
expect 0 "sound; closed, 1 part" check twelve.glb --solid
expect 0 "faces: " wrap cube.obj -o wrapped.glb --alpha 0.4
expect 0 "sound; closed, 1 part" check wrapped.glb --solid
expect 2 "are the most" wrap cube.obj -o absurd.glb --alpha 0.000001
[ ! -e absurd.glb ] || fail "a refused wrap has left a file"

# Morph targets and animations of nodes have no place in an asset, which is said, too.
cat >moving.gltf <<'END'
{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"targets":[{"POSITION":1}]}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},
{"bufferView":1,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0.1],"max":[0,0,0.1]},
{"bufferView":2,"componentType":5126,"count":2,"type":"SCALAR","min":[0],"max":[1]},
{"bufferView":3,"componentType":5126,"count":2,"type":"VEC4"}],
"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":36},
{"buffer":0,"byteOffset":72,"byteLength":8},{"buffer":0,"byteOffset":80,"byteLength":32}],
"animations":[{"name":"turn","samplers":[{"input":2,"output":3}],
"channels":[{"sampler":0,"target":{"node":0,"path":"rotation"}}]}],"buffers":[{"byteLength":112,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAAAAAAAAADNzMw9AAAAAAAAAADNzMw9AAAAAAAAAADNzMw9AAAAAAAAgD8AAAAAAAAAAAAAAAAAAIA/AAAAAAAAgD8AAAAAAAAAAA=="}]}
END
expect 0 "morph targets" repair moving.gltf -o still.glb
expect 0 "animations of nodes" repair moving.gltf -o still.glb --json

# Neither a limit of time nor Ctrl-C leaves half a file.
expect 1 "took more than 1 s" wrap sound.glb -o slow.glb --alpha 0.002 --asset-timeout 1
"$program" wrap sound.glb -o slow.glb --alpha 0.002 >said 2>&1 &
sleep 2
kill -INT $!
wait $!
[ $? = 130 ] || { fail "an interrupted wrap has another exit status"; cat said; }
[ -z "$(ls | grep slow)" ] || fail "an interrupted wrap has left $(ls | grep slow)"
exit $((failures > 0))
