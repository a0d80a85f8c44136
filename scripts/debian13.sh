#!/usr/bin/env bash
# Builds the project on Debian 13 (GCC 14, LibTorch 2.6, Embree 4) inside a folder made by debootstrap and runs all
# tests, both parts of the quickstart at their smallest setting, and the packages in a bare Debian 13; needs root. The
# folder is kept, so a second run only rebuilds.
#   scripts/debian13.sh [FOLDER [STEP…]]
#     FOLDER   default /var/tmp/anigen-debian13
#     STEP     tests, quickstart, packages, clang (builds everything with clang, whose warnings are errors, too);
#              default: all, in that order
set -euo pipefail
cd "$(dirname "$0")/.."
root=${1:-/var/tmp/anigen-debian13}
[ $# -eq 0 ] || shift
steps=("$@")
[ ${#steps[@]} -gt 0 ] || steps=(tests quickstart packages clang)
for step in "${steps[@]}"; do
  case $step in tests | quickstart | packages | clang) ;; *) echo "debian13: no step '$step'; see the head of $0" >&2; exit 2 ;; esac
done
. scripts/bare_debian.sh

enter trixie "$root"
mkdir -p "$root/project/shared" "$root/root/.ccache"
# A copy, so that build folders of the two systems stay apart.
copy_checkout "$root/project/anigen"
[ -d ../shared ] && bind ../shared "$root/project/shared"
# What npm brought, for the tests in a browser: npm may reach no registry from inside.
if [ -d .cache/node ]; then
  mkdir -p "$root/project/anigen/.cache"
  cp -a .cache/node "$root/project/anigen/.cache/"
fi

for step in "${steps[@]}"; do
  echo "debian13: $step"
  case $step in
    tests)
      # With the programs that some tests skip without.
      inside "$root" 'apt-get update -qq; apt-get install -y -qq --no-install-recommends nodejs chromium assimp-testmodels python3-fusepy >/dev/null
        cd /project/anigen && scripts/test.sh' ;;
    quickstart) inside "$root" 'cd /project/anigen && scripts/quickstart.sh --smallest && scripts/quickstart.sh --train --smallest' ;;
    packages)
      inside "$root" 'cd /project/anigen && apt-get install -y -qq --no-install-recommends file >/dev/null && scripts/build.sh && cpack --config build/release/CPackConfig.cmake -B /packages'
      enter trixie "$root-bare"
      rm -rf "$root-bare/packages"
      cp -r "$root/packages" "$root-bare/packages"
      cp examples/creatures/deer.png "$root-bare/root/deer.png"
      inside "$root-bare" 'cd /root && rm -rf out && apt-get update -qq && apt-get install -y -qq --no-install-recommends /packages/anigen_*.deb /packages/anigen-weights_*.deb /packages/python3-anigen_*.deb >/dev/null
        anigen-generate deer.png -o out
        anigen-rig out/*/mesh.glb -o rigged.glb
        anigen-eval --help >/dev/null
        python3 -c "import anigen; asset, how = anigen.rig(anigen.load(\"rigged.glb\")); anigen.save(asset, \"again.glb\"); print(how)"
        ls -l out/* rigged.glb again.glb' ;;
    clang)
      inside "$root" 'cd /project/anigen && apt-get install -y -qq --no-install-recommends clang libclang-rt-19-dev libomp-dev >/dev/null
        cmake --preset release -B build/clang -DCMAKE_C_COMPILER=clang -DCMAKE_CXX_COMPILER=clang++ -DCMAKE_BUILD_TYPE=Debug >/dev/null && cmake --build build/clang -- -k 0' ;;
  esac
done
