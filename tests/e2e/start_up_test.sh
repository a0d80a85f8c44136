#!/usr/bin/env bash
# Programs start without LibTorch, whose libraries take half a second to load; --help and errors of the command line
# need none of it, and --version loads it. OpenCV, a tenth of a second, is loaded by the first picture.
#   start_up_test.sh FOLDER_OF_PROGRAMS
set -euo pipefail
failed=0
fail() { echo "FAILED: $*"; failed=1; }
for name in inspect prepare eval rig animate train encode generate experiment mesh studio; do
  program=$1/anigen-$name
  if [[ $name = mesh || $name = studio ]] && [ ! -e "$program" ]; then continue; fi  # needs CGAL, cpp-httplib
  libraries=$(ldd "$program")
  if grep -q torch <<<"$libraries"; then fail "anigen-$name links LibTorch"; fi
  if grep -q opencv <<<"$libraries"; then fail "anigen-$name links OpenCV"; fi
  for argument in --help --no-such-option; do
    loaded=$( (LD_DEBUG=files "$program" "$argument" 2>&1 || true) | grep -c 'anigen-torch.so.*needed\|file=anigen-torch\|libtorch' || true)
    [ "$loaded" -eq 0 ] || fail "anigen-$name $argument loads LibTorch"
  done
done
for name in inspect prepare eval rig train encode generate; do
  "$1/anigen-$name" --version | grep -q '^LibTorch ' || fail "anigen-$name --version does not name LibTorch"
done
# Of what they share, programs link their own part alone: CGAL, which makes a binary GPL-3, is in rig, mesh and studio.
for name in inspect prepare eval animate train encode generate experiment; do
  functions=$(nm -C "$1/anigen-$name" | grep -c 'CGAL::' || true)
  [ "$functions" -eq 0 ] || fail "anigen-$name links CGAL"
done
# Objects that both the program and the module construct would be constructed, and destroyed, twice: constants of the
# library that need construction stay local to their source, or are constexpr.
constructed() { nm -DC --defined-only "$1" | awk '$2 == "B"' | cut -d' ' -f3- | grep '^anigen::' | sort; }
for name in inspect prepare eval rig train encode generate studio; do
  if [ ! -e "$1/anigen-$name" ]; then continue; fi
  twice=$(comm -12 <(constructed "$1/anigen-$name") <(constructed "$1/../lib/anigen/anigen-torch.so"))
  [ -z "$twice" ] || fail "anigen-$name and its module both construct $twice"
done
# The program and the module that it loads share what core holds: a signal, the log, the form of the kernels.
ANIGEN_KERNELS=portable "$1/anigen-train" --version | grep -q '^kernels portable' || fail "kernels are not shared"
# OpenBLAS takes kernels as wide as this processor has, loaded with the program (eval) or later (train).
for name in eval train; do
  said=$(env -u OPENBLAS_CORETYPE OPENBLAS_VERBOSE=2 "$1/anigen-$name" --version 2>&1)
  grep -q 'OpenBLAS core' <<<"$said" || fail "anigen-$name does not name the kernels of OpenBLAS"
  if grep -q 'OpenBLAS core [SHZ]' <<<"$said"; then
    taken=$(grep -o 'Core: .*' <<<"$said" | tail -n 1 || true)
    case $taken in ''|*SkylakeX|*Cooperlake|*SapphireRapids|*Haswell|*Zen) ;; *) fail "anigen-$name: OpenBLAS takes ${taken#Core: }" ;; esac
  fi
done
exit $failed
