#!/usr/bin/env bash
# Programs take the options of every job of the experiments that come with the project, and their trainings' configs.
# All of them take some minutes, most of it to load LibTorch for each config; ctest names a few.
#   experiments_test.sh FOLDER_OF_PROGRAMS FOLDER_OF_EXPERIMENTS [NAME.json...]
set -euo pipefail
failed=0 checked=0 skipped=0
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
check() {
  checked=$((checked + 1))
  "$1/anigen-experiment" run "${@:2}" --dry-run --quiet -o "$out" > "$out.txt" 2>&1 && return
  # Public rigs are no part of the project (scripts/fetch_rigs.sh).
  if grep -q '/rigs: no such file or folder' "$out.txt"; then skipped=$((skipped + 1)); return; fi
  echo "FAILED ${*:2}:"
  tail -n 3 "$out.txt"
  failed=$((failed + 1))
}
names=("${@:3}")
if [ ${#names[@]} -eq 0 ]; then mapfile -t names < <(cd "$2" && ls ./*.json paper/*.json | grep -v /all.json); fi
for name in "${names[@]}"; do
  # At its smallest an experiment of a paper has the jobs of every size.
  if [[ $name = paper/* ]]; then check "$1" "$2/$name" --scale tiny; else check "$1" "$2/$name"; fi
done
rm -f "$out.txt"
echo "$checked experiments, $failed refused, $skipped without their rigs"
[ "$failed" -eq 0 ]
