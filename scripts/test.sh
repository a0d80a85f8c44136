#!/usr/bin/env bash
# Installs what is missing, builds, and runs every test. The last line is the count of passed, failed, skipped.
#   scripts/test.sh [release|debug|asan] [ctest options, for example -L parity]
set -euo pipefail
cd "$(dirname "$0")/.."
preset=release
case ${1:-} in release|debug|asan) preset=$1; shift ;; esac

started=$(date +%s)
scripts/setup.sh
built=$(date +%s)
scripts/build.sh "$preset"
tested=$(date +%s)

report=build/$preset/tests.xml
export NODE_PATH=$PWD/.cache/node/node_modules${NODE_PATH:+:$NODE_PATH}
# Several tests run at a time: threads that wait must not spin.
export OMP_WAIT_POLICY=passive
# Of the asan preset. The module with LibTorch and the programs hold the same libraries; its names are bound to theirs.
# The search for leaks crashes at thread-local storage of modules that are loaded later, unless it lets that alone.
export LSAN_OPTIONS=suppressions=$PWD/tests/support/leaks.txt:print_suppressions=0 ASAN_OPTIONS=detect_odr_violation=1:intercept_tls_get_addr=0
# Test programs have OpenBLAS loaded before they run (anigen/core/openblas.h).
core=$("build/$preset/bin/anigen-inspect" --version | sed -n 's/.*OpenBLAS core \([[:alnum:]]*\)$/\1/p')
[ -z "$core" ] || export OPENBLAS_CORETYPE=$core
status=0
# No test needs a network: with ANIGEN_WITHOUT_NETWORK=1 they run where there is the loopback interface alone (root).
alone=()
if [ -n "${ANIGEN_WITHOUT_NETWORK:-}" ]; then
  alone=(unshare --net bash -c 'ip link set lo up && exec "$@"' bash)
  echo "tests run without a network: $("${alone[@]}" ip -brief link | cut -d ' ' -f 1 | paste -s -d ' ')"
fi
"${alone[@]}" ctest --test-dir "build/$preset" --output-on-failure --no-tests=error -j "$(nproc)" \
  --test-output-size-passed 65536 --test-output-truncation middle --output-junit "$PWD/$report" "$@" || status=$?

finished=$(date +%s)
echo "setup $((built - started)) s, build $((tested - built)) s, tests $((finished - tested)) s"
# Parity tests by the folder that their fixture lies in, which the runner prints first.
awk -v here="$PWD/" '
  /<testcase / { parity = /name="parity\./; skips = 0 }
  parity && /<skipped / { skips = 1; skipped++ }
  parity && !skips && match($0, /fixture from .*/) {
    folder = substr($0, RSTART + 13)
    if (index(folder, here) == 1) folder = substr(folder, length(here) + 1)
    ran[folder]++
  }
  END {
    for (folder in ran) text = text (text == "" ? "" : ", ") ran[folder] " ran from " folder
    printf "parity: %s, %d skipped\n", text == "" ? "none ran" : text, skipped
  }' "$report"
# A program of many cases counts by them, as GoogleTest sums them up; any other test is one case.
awk '
  function number(line) { match(line, /[0-9]+ test/); return substr(line, RSTART, RLENGTH - 5) + 0 }
  /<testcase / { state = match($0, /status="[a-z]+"/) ? substr($0, RSTART + 8, RLENGTH - 9) : "run"; sums = good = bad = skips = 0 }
  /^(.*>)?\[  PASSED  \] [0-9]+ test/ { good = number($0); sums = 1 }
  /^\[  FAILED  \] [0-9]+ test/ { bad = number($0) }
  /^\[  SKIPPED \] [0-9]+ test/ { skips = number($0) }
  /<\/testcase>/ {
    if (state == "fail") bad = bad > 0 ? bad : 1
    else if (state == "notrun" || state == "disabled") { good = bad = 0; skips = 1 }
    else if (!sums || bad > 0) { good = 1; bad = 0 }  # ctest says whether it passed: some tests want a failure
    passed += good; failed += bad; skipped += skips
  }
  END { printf "%d passed, %d failed, %d skipped\n", passed, failed, skipped }' "$report"
exit "$status"
