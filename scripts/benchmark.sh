#!/usr/bin/env bash
# Builds and runs the benchmarks; figures go to the screen and as JSON to build/release/benchmarks/.
# Compare only figures of one run: speeds of a shared machine wander.
#   scripts/benchmark.sh [Google Benchmark options, for example --benchmark_filter=import]
set -euo pipefail
cd "$(dirname "$0")/.."
scripts/build.sh release
mkdir -p build/release/benchmarks
for program in build/release/benchmarks/benchmark_*; do
  [ -x "$program" ] && [ ! -d "$program" ] || continue
  "$program" --benchmark_out="$program.json" --benchmark_out_format=json "$@"
done
