#!/usr/bin/env bash
# Checks a folder of public rigs against a list of their SHA-256, and says where each file that is missing or differs
# comes from. Needs no network; docs/assets.md says how to fetch the files.
#   scripts/fetch_rigs.sh [--list FILE] [--urls] FOLDER
#     --list FILE  datasets/public_rigs.csv by default, which names the 44 rigs that the tests and tables use
#     --urls       one line per file to fetch: its place below FOLDER, a tab, its URL
# Exit status: 0 when every file is there and as listed, 1 when not, 2 for a wrong call.
set -euo pipefail
list=$(dirname "$0")/../datasets/public_rigs.csv folder='' urls=''
while [ $# -gt 0 ]; do
  case $1 in
    --list) list=${2:?--list needs a file}; shift 2 ;;
    --urls) urls=1; shift ;;
    -h|--help) sed -n '2,7s/^# \{0,1\}//p' "$0"; exit 0 ;;
    -*) echo "fetch_rigs: unknown option '$1'; see --help" >&2; exit 2 ;;
    *) [ -z "$folder" ] || { echo "fetch_rigs: one folder, please; see --help" >&2; exit 2; }
       folder=$1; shift ;;
  esac
done
[ -n "$folder" ] || { echo "fetch_rigs: name the folder; see --help" >&2; exit 2; }
[ -r "$list" ] || { echo "fetch_rigs: cannot read the list $list" >&2; exit 2; }

all=0 missing=0 different=0
# Columns behind the path may be quoted; they are not needed here.
while IFS=, read -r sha256 _ file repository revision path _; do
  [ "$sha256" != sha256 ] || continue
  all=$((all + 1))
  problem=''
  if [ ! -f "$folder/$file" ]; then
    missing=$((missing + 1)) problem=missing
  elif [ "$(sha256sum <"$folder/$file" | cut -d ' ' -f 1)" != "$sha256" ]; then
    different=$((different + 1)) problem='SHA-256 differs'
  fi
  [ -n "$problem" ] || continue
  url="https://github.com/$repository/raw/$revision/${path// /%20}"
  if [ -n "$urls" ]; then
    printf '%s\t%s\n' "$file" "$url"
  else
    echo "$file: $problem; revision $revision of $url"
  fi
done <"$list"
[ $all -gt 0 ] || { echo "fetch_rigs: $list names no file" >&2; exit 2; }
summary="$((all - missing - different)) of $all files are there and as listed"
[ $((missing + different)) -gt 0 ] || { echo "complete: $summary" >&2; exit 0; }
echo "not complete: $summary, $missing missing, $different different" >&2
exit 1
