#!/usr/bin/env bash
# Builds a user's project that takes AniGen by add_subdirectory(), and runs its program.
#   embedding_test.sh CHECKOUT
set -euo pipefail
root=$(realpath "$1")
build=$(mktemp -d)
trap 'rm -rf "$build"' EXIT
cmake -G Ninja -S "$root/tests/e2e/embedding" -B "$build" -D ANIGEN_ROOT="$root" -D ANIGEN_WITH_TORCH=OFF \
  -D CMAKE_BUILD_TYPE=Debug -D CMAKE_CXX_FLAGS_DEBUG=-O0 -D CMAKE_UNITY_BUILD=ON >"$build/configure.txt" 2>&1 || { cat "$build/configure.txt"; exit 1; }
# A part of another project brings neither its tests nor its benchmarks.
if grep -q '^ANIGEN_BUILD_\(TESTS\|BENCHMARKS\):BOOL=ON' "$build/CMakeCache.txt"; then
  echo "error: tests or benchmarks are on although AniGen is a part of another project" >&2
  exit 1
fi
cmake --build "$build" --target count_joints >"$build/build.txt" 2>&1 || { tail -n 40 "$build/build.txt"; exit 1; }
"$build/count_joints"
