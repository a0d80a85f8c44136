#!/usr/bin/env bash
# Fuzzes all readers by coverage (libFuzzer; needs clang and libclang-rt-*-dev) and says what each found.
#   scripts/fuzz.sh [--fast] [--borrow] [SECONDS for each target, default 60] [TARGET…]
#     --fast     without the sanitizers, many times as many runs; what it finds is for a run with them
#     --borrow   starts from files of others, too: of ../shared where it is there, and of Debian's assimp-testmodels
#   scripts/fuzz.sh --coverage [TARGET…]   lines of each reader that the inputs reach (needs llvm)
#   scripts/fuzz.sh --keep                 the least inputs that reach as much become fuzz/corpus.tar.xz
#   scripts/fuzz.sh --table                a table of the runs so far, their coverage and the replay (preset release)
# Inputs come from fuzz/seeds.py, fuzz/corpus.tar.xz and files of the repository; what was learnt stays in build/fuzz/corpus, with
# --borrow in build/fuzz/borrowed, of which the repository keeps nothing. build/fuzz/runs.csv has a line for each target
# that ran. An input that crashes, hangs or asks for more than 2 GB is kept in build/fuzz/findings, and the script exits with
# 1: mend the reader, and keep the input in the corpus and, made small, as a test.
set -euo pipefail
cd "$(dirname "$0")/.."
# Targets write small files many times a second: to memory.
[ ! -w /dev/shm ] || export TMPDIR=/dev/shm
corpus=build/fuzz/corpus borrowed=build/fuzz/borrowed findings=build/fuzz/findings
declare -A extensions=([glb]=glb [gltf]=gltf [draco]="" [meshopt]="" [obj]=obj [mtl]=mtl [ply]=ply [stl]=stl [three_mf]=3mf [bvh]=bvh
  [npz]=npz [npz_objects]=npz [pickle]=pkl [torch]="pt pth" [safetensors]=safetensors [text_rig]=txt [json]=json
  [image]="png jpg webp bmp tif" [onnx]=onnx [http]="" [experiment]=json)

# Builds the targets: under the sanitizers in build/fuzz; without them, and counting lines, in build/fuzz-fast.
build() {
  local options=()
  [ "$1" != build/fuzz-fast ] ||
    options=(-DANIGEN_SANITIZE=OFF -DCMAKE_CXX_FLAGS="-fprofile-instr-generate -fcoverage-mapping -D_GLIBCXX_ASSERTIONS")
  cmake --preset fuzz -B "$1" "${options[@]}" >/tmp/anigen-fuzz-configure.$$ 2>&1 || { cat /tmp/anigen-fuzz-configure.$$; exit 1; }
  rm -f /tmp/anigen-fuzz-configure.$$
  cmake --build "$1" --target fuzz_readers >/dev/null
}

# Files of up to 64 kB in some folders with an extension of the target become inputs in another: seed TARGET TO FROM…
seed() {
  local target=$1 to=$2 extension file
  shift 2
  mkdir -p "$to"
  for extension in ${extensions[$target]}; do
    find "$@" -path ./build -prune -o -path ./.cache -prune -o -iname "*.$extension" -size -64k -print 2>/dev/null |
      awk 'NR <= 60' | while IFS= read -r file; do cp -n "$file" "$to/$(md5sum <"$file" | cut -c1-12)"; done
  done
}

known() {
  [ -n "${extensions[$1]+there}" ] || { echo "fuzz: no target $1; there are: ${!extensions[*]}" >&2; exit 2; }
}

mkdir -p "$corpus" "$findings"
[ ! -e fuzz/corpus.tar.xz ] || tar -C "$corpus" --skip-old-files -xf fuzz/corpus.tar.xz
/usr/bin/python3 fuzz/seeds.py "$corpus"

# Functions in those sources that no input of a target reaches: they write, or look for files in folders.
not_read='write|save|encode_|append_utf8|append_line|append_vertices|to_json|header_text|headerB5cxx11ERKNS_4Mesh|choose_checkpoint|choose_flow_checkpoint|checkpoint_names|newest|step_of|picture_files|glb_bytes|base64_values|mesh_of_text_rig|refuse_unsound_mesh|check_array|descr_of|common_fields|fixed_width|3addEP3zip'
# The sources of a target that read.
sources() {
  case $1 in
    glb | gltf | draco | meshopt) echo anigen/io/gltf/{accessors,container,document,gltf,mesh,primitive,rig}.cpp ;;
    three_mf) echo anigen/io/three_mf.cpp ;;
    npz) echo anigen/io/arrays/{npy,npz,zip_seek}.cpp ;;
    npz_objects) echo anigen/io/arrays/{npz_objects,npz_samples,pickle_outline}.cpp ;;
    pickle) echo anigen/io/arrays/pickle{,_constructors,_scanner}.cpp ;;
    torch) echo anigen/io/arrays/torch_archive.cpp ;;
    safetensors) echo anigen/io/arrays/safetensors.cpp ;;
    bvh | text_rig) echo "anigen/io/rigs/$1.cpp" ;;
    json) echo anigen/core/config.cpp ;;
    http) echo anigen/studio/{access,api,job_options,server,submission,rebind,weight_strokes}.cpp ;;
    experiment) echo anigen/experiment/{file,plan}.cpp ;;
    *) echo "anigen/io/$1.cpp" ;;
  esac
}

if [ "${1:-}" = --coverage ]; then
  shift
  targets=("$@")
  [ ${#targets[@]} -gt 0 ] || mapfile -t targets < <(printf '%s\n' "${!extensions[@]}" | sort)
  build build/fuzz-fast
  version=$(clang -dumpversion | cut -d. -f1)
  rm -f build/fuzz-fast/coverage.csv.*
  printf '%-12s %7s %8s %8s  %s\n' target lines reached percent "functions with the most lines not reached"
  for target in "${targets[@]}"; do
    known "$target"
    # What several targets read with is counted by the inputs of all.
    case $target in
      glb | gltf | draco | meshopt) inputs=(glb gltf draco meshopt) ;;
      obj) inputs=(obj mtl ply stl text_rig three_mf) ;;
      pickle) inputs=(pickle torch npz_objects) ;;
      npz | npz_objects) inputs=(npz npz_objects torch three_mf) ;;
      json) inputs=(json experiment http) ;;
      *) inputs=("$target") ;;
    esac
    profiles=()
    for input in "${inputs[@]}"; do
      profiles+=("build/fuzz-fast/$target-$input.profraw")
      mkdir -p "$corpus/$input" "$borrowed/$input"
      LLVM_PROFILE_FILE=${profiles[-1]} "build/fuzz-fast/fuzz/fuzz_$input" -runs=0 -max_len=65536 "$corpus/$input" "$borrowed/$input" >"build/fuzz-fast/$input.coverage.log" 2>&1
    done
    "llvm-profdata-$version" merge -sparse "${profiles[@]}" -o "build/fuzz-fast/$target.profdata"
    # shellcheck disable=SC2046
    "llvm-cov-$version" export -format=lcov "build/fuzz-fast/fuzz/fuzz_readers" -instr-profile="build/fuzz-fast/$target.profdata" $(sources "$target") >"build/fuzz-fast/$target.lcov"
    # A line belongs to the function that begins last before it.
    awk -v target="$target" -v not_read="$not_read" '
      function count_file(   line, name) {
        for (line = 1; line <= last; line++) {
          if (line in begins) name = begins[line]
          if (!(line in runs) || name ~ not_read) continue
          lines++
          if (runs[line] > 0) reached++; else missed[name]++
        }
        split("", begins); split("", runs); last = 0
      }
      /^FN:/ { split(substr($0, 4), part, ","); begins[part[1]] = part[2] }
      /^DA:/ { split(substr($0, 4), part, ","); runs[part[1]] = part[2]; if (part[1] + 0 > last) last = part[1] + 0 }
      /^end_of_record/ { count_file() }
      END {
        for (name in missed) order[++names] = sprintf("%6d %s", missed[name], name)
        for (shown = 0; shown < 5 && shown < names; shown++) {
          most = 1
          for (i = 1; i <= names; i++) if (order[i] > order[most]) most = i
          text = text order[most]
          order[most] = ""
        }
        printf "%-12s %7d %8d %7.1f%% %s\n", target, lines, reached, 100 * reached / lines, text
        printf "%s,%d,%d\n", target, lines, reached >"build/fuzz-fast/coverage.csv." target
      }' "build/fuzz-fast/$target.lcov" | c++filt
  done
  # For tables: of every target, lines and runs so far.
  { echo target,lines,reached && cat build/fuzz-fast/coverage.csv.*; } >build/fuzz/coverage.csv
  exit
fi

if [ "${1:-}" = --keep ]; then
  least=$(mktemp -d)
  trap 'rm -rf "$least"' EXIT
  for target in $(printf '%s\n' "${!extensions[@]}" | sort); do
    [ -d "$corpus/$target" ] || continue
    mkdir "$least/$target"
    LLVM_PROFILE_FILE=/dev/null "build/fuzz-fast/fuzz/fuzz_$target" -merge=1 -max_len=16384 -timeout=10 -rss_limit_mb=2048 "$least/$target" "$corpus/$target" >"build/fuzz/$target.merge.log" 2>&1
    # Fixtures of regressions stay, whatever they reach.
    for file in "$corpus/$target"/found_*; do if [ -e "$file" ]; then cp "$file" "$least/$target/"; fi; done
    printf '%-12s %6d files %9d bytes\n' "$target" "$(find "$least/$target" -type f | wc -l)" "$(cat "$least/$target"/* | wc -c)"
  done
  [ -n "$(find "$least" -type f -print -quit)" ] || { echo "fuzz: nothing to keep; fuzz/corpus.tar.xz stays as it is" >&2; exit 1; }
  tar -C "$least" --sort=name --owner=0 --group=0 --numeric-owner --mtime=@0 -cf - . | xz -9e >fuzz/corpus.tar.xz
  stat -c '%n: %s bytes' fuzz/corpus.tar.xz
  exit
fi

if [ "${1:-}" = --table ]; then
  # Several targets read through the same sources; every line of build/fuzz/runs.csv that is not clean is a finding.
  build/release/fuzz/fuzz_replay build/release/fuzz/replayed_corpus 2>/dev/null | grep -E '^[a-z_]+ +[0-9]+ ' >build/fuzz/replay.txt
  echo '| target | million runs | hours | lines reached | findings | inputs kept | slowest of them |'
  echo '|---|--:|--:|--:|--:|--:|--:|'
  awk '
    FILENAME ~ /runs.csv/ { split($0, part, ","); if (FNR > 1) {
      runs[part[1]] += part[4]; seconds[part[1]] += part[3]; if ($0 !~ /"clean"$/) found[part[1]]++ } }
    FILENAME ~ /coverage.csv/ { split($0, part, ","); if (FNR > 1) lines[part[1]] = sprintf("%.1f %%", 100 * part[3] / part[2]) }
    FILENAME ~ /replay.txt/ && NF == 4 && ($1 in runs) { inputs[$1] = $2; slowest[$1] = $4 " ms"; order[++targets] = $1 }
    function row(name, of_runs, of_seconds, of_lines, of_findings, of_inputs, of_slowest) {
      printf "| %s | %.2f | %.2f | %s | %d | %d | %s |\n", name, of_runs / 1e6, of_seconds / 3600, of_lines, of_findings, of_inputs, of_slowest
    }
    END {
      for (i = 1; i <= targets; i++) {
        name = order[i]
        row(name, runs[name], seconds[name], lines[name], found[name], inputs[name], slowest[name])
        all_runs += runs[name]; all_seconds += seconds[name]; all_found += found[name]; all_inputs += inputs[name]
      }
      row("all", all_runs, all_seconds, "", all_found, all_inputs, "")
    }' build/fuzz/runs.csv build/fuzz/coverage.csv build/fuzz/replay.txt
  exit
fi

at=build/fuzz borrow=
while true; do
  case ${1:-} in
    --fast) at=build/fuzz-fast; shift ;;
    --borrow) borrow=yes; shift ;;
    *) break ;;
  esac
done
build $at
seconds=${1:-60}
[ $# -gt 0 ] && shift
targets=("$@")
[ ${#targets[@]} -gt 0 ] || mapfile -t targets < <(printf '%s\n' "${!extensions[@]}" | sort)
status=0
[ -e build/fuzz/runs.csv ] || echo target,sanitizers,seconds,runs,edges,inputs,result >build/fuzz/runs.csv
printf '%-12s %10s %8s %8s %s\n' target runs edges corpus result
for target in "${targets[@]}"; do
  known "$target"
  case $target in experiment) seed "$target" "$corpus/$target" experiments ;; *) seed "$target" "$corpus/$target" . ;; esac
  into=$corpus/$target folders=("$corpus/$target")
  if [ -n "$borrow" ]; then
    into=$borrowed/$target folders=("$borrowed/$target" "$corpus/$target")
    seed "$target" "$into" ../shared/assets ../shared/rigs ../shared/parity /usr/share/assimp/models
  fi
  log=build/fuzz/$target.log
  dictionary=()
  words=fuzz/${target/glb/gltf}.dict
  [ ! -e "$words" ] || dictionary=("-dict=$words")
  result=clean began=$SECONDS
  LLVM_PROFILE_FILE=/dev/null "$at/fuzz/fuzz_$target" "${folders[@]}" -max_total_time="$seconds" -timeout=10 -rss_limit_mb=2048 -max_len=65536 \
    "${dictionary[@]}" -artifact_prefix="$findings/$target-" -print_final_stats=1 >"$log" 2>&1 ||
    { result="FOUND $(grep -hoE 'ERROR: .*|fuzz: .*|runtime error: .*' "$log" | head -n 1 | cut -c1-120)"; status=1; }
  runs=$(grep -oE 'number_of_executed_units: [0-9]+' "$log" | grep -oE '[0-9]+' | tail -n 1 || true)
  edges=$(grep -oE 'cov: [0-9]+' "$log" | tail -n 1 | grep -oE '[0-9]+' || true)
  files=$(find "$into" -type f | wc -l)
  printf '%-12s %10s %8s %8s %s\n' "$target" "${runs:-?}" "${edges:-?}" "$files" "$result"
  echo "$target,$([ $at = build/fuzz ] && echo yes || echo no),$((SECONDS - began)),${runs:-0},${edges:-0},$files,\"$result\"" >>build/fuzz/runs.csv
done
exit "$status"
