#!/usr/bin/env bash
# Fuzzes all readers by coverage (libFuzzer; needs clang and libclang-rt-*-dev) and says what each found.
#   scripts/fuzz.sh [SECONDS for each target, default 60] [TARGET…]
#   scripts/fuzz.sh --coverage     lines of the readers that the inputs reach (needs llvm)
#   scripts/fuzz.sh --keep         the least inputs that reach as much become fuzz/corpus.tar.xz
# Inputs come from fuzz/corpus.tar.xz, from files of the repository, of ../shared where it is there, and of Debian's
# assimp-testmodels; what was learnt stays in build/fuzz/corpus, and build/fuzz/runs.csv has a line for each target that
# ran. An input that crashes, hangs or asks for more than 2 GB is kept in build/fuzz/findings, and the script exits with
# 1: mend the reader, and keep the input in the corpus and, made small, as a test.
set -euo pipefail
cd "$(dirname "$0")/.."
# Targets write small files many times a second: to memory.
[ ! -w /dev/shm ] || export TMPDIR=/dev/shm
corpus=build/fuzz/corpus findings=build/fuzz/findings
declare -A extensions=([glb]=glb [gltf]=gltf [draco]= [meshopt]= [obj]=obj [mtl]=mtl [ply]=ply [stl]=stl [three_mf]=3mf [bvh]=bvh
  [npz]=npz [npz_objects]=npz [pickle]=pkl [torch]="pt pth" [safetensors]=safetensors [text_rig]=txt [json]=json
  [image]="png jpg webp bmp tif" [onnx]=onnx [http]= [experiment]=json)

configured() {
  cmake --preset fuzz "$@" >/tmp/anigen-fuzz-configure.$$ 2>&1 || { cat /tmp/anigen-fuzz-configure.$$; exit 1; }
  rm -f /tmp/anigen-fuzz-configure.$$
}

# Files of up to 64 kB with one of these extensions become inputs of a target.
seed() {
  local target=$1 extension file
  shift
  mkdir -p "$corpus/$target"
  for extension in "$@"; do
    find . ../shared/assets ../shared/rigs ../shared/parity /usr/share/assimp/models -path ./build -prune -o -iname "*.$extension" -size -64k -print 2>/dev/null |
      awk 'NR <= 60' | while IFS= read -r file; do cp -n "$file" "$corpus/$target/$(md5sum <"$file" | cut -c1-12)"; done
  done
}

known() {
  [ -n "${extensions[$1]+there}" ] || { echo "fuzz: no target $1; there are: ${!extensions[*]}" >&2; exit 2; }
}

mkdir -p "$corpus" "$findings"
[ ! -e fuzz/corpus.tar.xz ] || tar -C "$corpus" --skip-old-files -xf fuzz/corpus.tar.xz

if [ "${1:-}" = --coverage ]; then
  build=build/fuzz-coverage
  configured -B $build -DANIGEN_FUZZ=OFF -DANIGEN_SANITIZE=OFF -DANIGEN_BUILD_FUZZ_REPLAY=ON \
    -DCMAKE_CXX_FLAGS="-fprofile-instr-generate -fcoverage-mapping"
  cmake --build $build --target fuzz_replay >/dev/null
  LLVM_PROFILE_FILE=$build/replay.profraw $build/fuzz/fuzz_replay "$corpus"
  version=$(clang -dumpversion | cut -d. -f1)
  "llvm-profdata-$version" merge -sparse $build/replay.profraw -o $build/replay.profdata
  "llvm-cov-$version" report $build/fuzz/fuzz_replay -instr-profile=$build/replay.profdata anigen/io anigen/core/config.cpp \
    anigen/experiment/file.cpp anigen/experiment/plan.cpp anigen/studio/{access,api,job_options,server,submission,rebind,weight_strokes}.cpp |
    awk '/\.cpp/ { printf "%-44s %6d lines %8s\n", $1, $8, $10 }'
  exit
fi

configured
cmake --build --preset fuzz >/dev/null

if [ "${1:-}" = --keep ]; then
  least=$(mktemp -d)
  trap 'rm -rf "$least"' EXIT
  for target in $(printf '%s\n' "${!extensions[@]}" | sort); do
    [ -d "$corpus/$target" ] || continue
    mkdir "$least/$target"
    "build/fuzz/fuzz/fuzz_$target" -merge=1 -max_len=4096 -timeout=10 -rss_limit_mb=2048 "$least/$target" "$corpus/$target" >"build/fuzz/$target.merge.log" 2>&1
    # Fixtures of regressions stay, whatever they reach.
    for file in "$corpus/$target"/found_*; do if [ -e "$file" ]; then cp "$file" "$least/$target/"; fi; done
    printf '%-12s %6d files %9d bytes\n' "$target" "$(find "$least/$target" -type f | wc -l)" "$(cat "$least/$target"/* | wc -c)"
  done
  tar -C "$least" --sort=name --owner=0 --group=0 --numeric-owner --mtime=@0 -cf - . | xz -9e >fuzz/corpus.tar.xz
  stat -c '%n: %s bytes' fuzz/corpus.tar.xz
  exit
fi

seconds=${1:-60}
[ $# -gt 0 ] && shift
targets=("$@")
[ ${#targets[@]} -gt 0 ] || mapfile -t targets < <(printf '%s\n' "${!extensions[@]}" | sort)
status=0
[ -e build/fuzz/runs.csv ] || echo target,seconds,runs,edges,inputs,result >build/fuzz/runs.csv
printf '%-12s %10s %8s %8s %s\n' target runs edges corpus result
for target in "${targets[@]}"; do
  known "$target"
  # shellcheck disable=SC2086
  seed "$target" ${extensions[$target]}
  log=build/fuzz/$target.log
  dictionary=()
  words=fuzz/${target/glb/gltf}.dict
  [ ! -e "$words" ] || dictionary=("-dict=$words")
  result=clean began=$SECONDS
  "build/fuzz/fuzz/fuzz_$target" "$corpus/$target" -max_total_time="$seconds" -timeout=10 -rss_limit_mb=2048 -max_len=65536 \
    "${dictionary[@]}" -artifact_prefix="$findings/$target-" -print_final_stats=1 >"$log" 2>&1 ||
    { result="FOUND $(grep -hoE 'ERROR: .*|fuzz: .*|runtime error: .*' "$log" | head -n 1 | cut -c1-120)"; status=1; }
  runs=$(grep -oE 'number_of_executed_units: [0-9]+' "$log" | grep -oE '[0-9]+' | tail -n 1 || true)
  edges=$(grep -oE 'cov: [0-9]+' "$log" | tail -n 1 | grep -oE '[0-9]+' || true)
  inputs=$(find "$corpus/$target" -type f | wc -l)
  printf '%-12s %10s %8s %8s %s\n' "$target" "${runs:-?}" "${edges:-?}" "$inputs" "$result"
  echo "$target,$((SECONDS - began)),${runs:-0},${edges:-0},$inputs,\"$result\"" >>build/fuzz/runs.csv
done
exit "$status"
