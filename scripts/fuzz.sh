#!/usr/bin/env bash
# Fuzzes the readers by coverage (libFuzzer; needs clang and libclang-rt-*-dev) and says what each found.
#   scripts/fuzz.sh [SECONDS for each reader, default 60] [READER…]
# Inputs come from the files of the repository, of ../shared where it is there, and of Debian's assimp-testmodels; what
# was learnt stays in build/fuzz/corpus. An input that crashes, hangs or asks for more than 2 GB is kept in
# build/fuzz/findings, and the script exits with 1: mend the reader, and keep the input as a test of tests/io.
set -euo pipefail
cd "$(dirname "$0")/.."
seconds=${1:-60}
[ $# -gt 0 ] && shift
cmake --preset fuzz >/tmp/anigen-fuzz-configure.$$ 2>&1 || { cat /tmp/anigen-fuzz-configure.$$; exit 1; }
rm -f /tmp/anigen-fuzz-configure.$$
cmake --build --preset fuzz >/dev/null

corpus=build/fuzz/corpus findings=build/fuzz/findings
mkdir -p "$findings"
# Files of up to 64 kB with one of these extensions become inputs of a reader.
seed() {
  local reader=$1 extension file
  shift
  mkdir -p "$corpus/$reader"
  for extension in "$@"; do
    find . ../shared/assets ../shared/rigs ../shared/parity /usr/share/assimp/models -path ./build -prune -o -iname "*.$extension" -size -64k -print 2>/dev/null |
      awk 'NR <= 60' | while IFS= read -r file; do cp -n "$file" "$corpus/$reader/$(md5sum <"$file" | cut -c1-12)"; done
  done
}
declare -A extensions=([glb]=glb [gltf]=gltf [obj]=obj [mtl]=mtl [ply]=ply [stl]=stl [three_mf]=3mf [bvh]=bvh [npz]=npz
  [npz_objects]=npz [pickle]=pkl [torch]="pt pth" [safetensors]=safetensors [text_rig]=txt [json]=json [image]="png jpg webp bmp tif")
readers=("$@")
[ ${#readers[@]} -gt 0 ] || mapfile -t readers < <(printf '%s\n' "${!extensions[@]}" | sort)
status=0
printf '%-12s %10s %8s %8s %s\n' reader runs edges corpus result
for reader in "${readers[@]}"; do
  [ -n "${extensions[$reader]:-}" ] || { echo "fuzz: no reader $reader; there are: ${!extensions[*]}" >&2; exit 2; }
  # shellcheck disable=SC2086
  seed "$reader" ${extensions[$reader]}
  log=build/fuzz/$reader.log
  result=clean
  "build/fuzz/fuzz/fuzz_$reader" "$corpus/$reader" -max_total_time="$seconds" -timeout=10 -rss_limit_mb=2048 -max_len=65536 \
    -artifact_prefix="$findings/$reader-" -print_final_stats=1 >"$log" 2>&1 || { result="FOUND $(grep -hoE 'ERROR: .*|fuzz: .*|runtime error: .*' "$log" | head -n 1 | cut -c1-120)"; status=1; }
  runs=$(grep -oE 'number_of_executed_units: [0-9]+' "$log" | grep -oE '[0-9]+' | tail -n 1 || true)
  edges=$(grep -oE 'cov: [0-9]+' "$log" | tail -n 1 | grep -oE '[0-9]+' || true)
  printf '%-12s %10s %8s %8s %s\n' "$reader" "${runs:-?}" "${edges:-?}" "$(find "$corpus/$reader" -type f | wc -l)" "$result"
done
exit "$status"
