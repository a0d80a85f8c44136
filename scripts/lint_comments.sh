#!/usr/bin/env bash
# Refuses comments of the sources that open a line as a riddle: with What, Which, Where, How, Who, Whether or
# "The same". The first sentence of a comment says what the thing is or does.
#   scripts/lint_comments.sh [folder…, default: anigen tests benchmarks examples]
set -euo pipefail
cd "$(dirname "$0")/.."
[ $# -gt 0 ] || set -- anigen tests benchmarks examples
found=$(grep -rnE --include='*.h' --include='*.cpp' --include='*.inc' \
  '^[[:space:]]*///?<? *(What|Which|Where|How|Who|Whether|The same)([^[:alnum:]_]|$)' "${@}" || true)
[[ -z $found ]] && exit 0
echo "$found"
echo "error: $(wc -l <<<"$found") comments open as a riddle; say what the thing is or does" >&2
exit 1
