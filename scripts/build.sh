#!/usr/bin/env bash
# Builds a preset (default: release) into build/<preset>. Programs land in build/<preset>/bin.
#   scripts/build.sh [--programs] [release|debug|asan|lean] [extra cmake -D options...]
#     --programs   programs alone, no tests, no benchmarks
set -euo pipefail
cd "$(dirname "$0")/.."
targets=()
if [ "${1:-}" = --programs ]; then targets=(--target programs); shift; fi
preset=${1:-release}
[ $# -gt 0 ] && shift
cmake --preset "$preset" "$@" >"/tmp/anigen-configure.$$" 2>&1 || { cat "/tmp/anigen-configure.$$"; exit 1; }
rm -f "/tmp/anigen-configure.$$"
cmake --build --preset "$preset" "${targets[@]}"
