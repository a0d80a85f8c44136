#!/usr/bin/env bash
# scripts/fetch_rigs.sh on folders that are complete, empty, and with one damaged file.
#   fetch_rigs_test.sh SOURCE_FOLDER            a list and folders made up here
#   fetch_rigs_test.sh SOURCE_FOLDER RIGS LIST  the real rigs below ANIGEN_ASSETS_DIR, or else RIGS; exit status 77
#                                               where they are missing (1 with ANIGEN_REQUIRE_FIXTURES=1)
set -uo pipefail
source=$1
script=$source/scripts/fetch_rigs.sh
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
failures=0

# expect STATUS TEXT COMMAND...: the exit status, and TEXT somewhere in what the command prints.
expect() {
  local status=$1 text=$2 found=0
  shift 2
  "$@" >"$work/said" 2>&1 || found=$?
  [ "$found" = "$status" ] || { echo "exit status $found, expected $status: $*"; cat "$work/said"; failures=$((failures + 1)); }
  grep -qF -- "$text" "$work/said" || { echo "no '$text' from: $*"; cat "$work/said"; failures=$((failures + 1)); }
}

if [ $# -eq 3 ]; then
  rigs=$2
  [ "$(basename "$rigs")" != assets ] || rigs=${ANIGEN_ASSETS_DIR:-$rigs}
  if [ ! -d "$rigs" ]; then
    echo "skipped: $rigs is not there"
    [ "${ANIGEN_REQUIRE_FIXTURES:-}" = 1 ] && exit 1
    exit 77
  fi
  files=$(($(wc -l <"$3") - 1))
  expect 0 "complete: $files of $files files" "$script" --list "$3" "$rigs"
  mkdir "$work/empty"
  expect 1 "$files missing" "$script" --list "$3" "$work/empty"
  [ "$(grep -c ': missing; revision' "$work/said")" = "$files" ] || { echo "not every file is named"; failures=$((failures + 1)); }
  exit $((failures > 0))
fi

mkdir -p "$work/rigs/a"
printf one >"$work/rigs/a/one.glb"
printf two >"$work/rigs/two.glb"
{
  echo sha256,bytes,file,repository,revision,path,licence,licence_evidence,author
  echo "$(printf one | sha256sum | cut -d ' ' -f 1),3,a/one.glb,owner/models,0123456789ab,sub folder/One.glb,CC0-1.0,strong,\"Somebody, and others\""
  echo "$(printf two | sha256sum | cut -d ' ' -f 1),3,two.glb,owner/others,ba9876543210,Two.glb,MIT,strong,Nobody"
} >"$work/list.csv"

expect 0 'complete: 2 of 2 files' "$script" --list "$work/list.csv" "$work/rigs"
printf tvo >"$work/rigs/two.glb"
expect 1 'two.glb: SHA-256 differs; revision ba9876543210 of https://github.com/owner/others/raw/ba9876543210/Two.glb' \
  "$script" --list "$work/list.csv" "$work/rigs"
grep -q one.glb "$work/said" && { echo 'a sound file is named'; failures=$((failures + 1)); }
rm "$work/rigs/a/one.glb"
expect 1 'a/one.glb: missing; revision 0123456789ab of https://github.com/owner/models/raw/0123456789ab/sub%20folder/One.glb' \
  "$script" --list "$work/list.csv" "$work/rigs"
expect 1 '0 of 2 files are there and as listed, 1 missing, 1 different' "$script" --list "$work/list.csv" "$work/rigs"
expect 1 $'two.glb\thttps://github.com/owner/others/raw/ba9876543210/Two.glb' "$script" --urls --list "$work/list.csv" "$work/rigs"
expect 1 '0 of 2 files are there' "$script" --list "$work/list.csv" "$work/no such folder"
expect 2 'cannot read the list' "$script" --list "$work/none.csv" "$work/rigs"
expect 2 'name the folder' "$script"
exit $((failures > 0))
