#!/usr/bin/env bash
# The quickstart's words: bad ones are refused before anything is installed or built.
#   quickstart_test.sh SCRIPT
set -uo pipefail
script=$1
refuses() { # expected words, then arguments
  local words=$1 said status
  shift
  said=$("$script" "$@" 2>&1)
  status=$?
  [ $status -eq 2 ] && [[ $said == *"$words"* ]] && return
  echo "quickstart $*: exit $status, said: $said" >&2
  exit 1
}
refuses "unknown option '--fast'" --fast
refuses "go with --train" --creatures 4
refuses "go with --train" --rigs .
refuses "does not go with --train" --train --image .
refuses "no such picture" --image /nowhere/frog.png
"$script" --help | grep -q -- '--train' || { echo "--help lacks --train" >&2; exit 1; }
