#!/usr/bin/env bash
# clang-format and clang-tidy over the C++ files that changed since a commit. Exits 1 where either finds something.
#   scripts/lint_changes.sh [COMMIT]     default: the commit before the last one
# COMMIT may also be a branch; uncommitted changes count. ANIGEN_LINT_MOST (default 12) limits how many sources
# clang-tidy reads, the most recently changed first: a source that uses LibTorch takes it half a minute.
set -euo pipefail
cd "$(dirname "$0")/.."
base=${1:-HEAD~1}
most=${ANIGEN_LINT_MOST:-12}
for tool in clang-format clang-tidy; do
  command -v "$tool" >/dev/null || { echo "error: $tool is missing (apt-get install $tool)" >&2; exit 2; }
done
git rev-parse --quiet --verify "$base^{commit}" >/dev/null ||
  { echo "nothing to compare with: no commit $base in this clone"; exit 0; }
mapfile -t files < <(git diff --name-only --diff-filter=d "$base" -- '*.h' '*.cpp')
((${#files[@]})) || { echo "no C++ file changed since $base"; exit 0; }

status=0
clang-format --dry-run -Werror "${files[@]}" || status=1

# Each source compiled alone, with the flags of its target; headers are read through the source of their name.
build=build/lint
cmake -G Ninja -S . -B "$build" -D CMAKE_BUILD_TYPE=Debug -D CMAKE_UNITY_BUILD=OFF \
  -D CMAKE_DISABLE_PRECOMPILE_HEADERS=ON -D ANIGEN_BUILD_EXAMPLES=ON >"/tmp/anigen-lint.$$" 2>&1 ||
  { cat "/tmp/anigen-lint.$$"; rm -f "/tmp/anigen-lint.$$"; exit 1; }
rm -f "/tmp/anigen-lint.$$"
sources=()
for file in "${files[@]}"; do
  [[ $file == *.h && -f ${file%.h}.cpp ]] && file=${file%.h}.cpp
  [[ $file == *.cpp ]] && grep -q "\"file\": \"$PWD/$file\"" "$build/compile_commands.json" && sources+=("$file")
done
mapfile -t sources < <(printf '%s\n' "${sources[@]}" | awk 'NF && !seen[$0]++' | xargs -r ls -t)
if ((${#sources[@]} > most)); then
  echo "clang-tidy reads $most of ${#sources[@]} changed sources (ANIGEN_LINT_MOST)"
  sources=("${sources[@]:0:most}")
fi
((${#sources[@]})) &&
  { printf '%s\0' "${sources[@]}" | xargs -0 -n 1 -P "$(nproc)" sh -c \
      'clang-tidy -p "$0" --quiet --warnings-as-errors="*" "$1" 2>/dev/null || { echo "clang-tidy refuses $1"; exit 1; }' "$build" ||
      status=1; }
echo "clang-format: ${#files[@]} files; clang-tidy: ${#sources[@]} sources"
exit "$status"
