#!/usr/bin/env bash
# Installs everything the project needs on Debian 12 or 13, from Debian's packages only. Safe to run again.
# third_party/README.md says what each package is for.
#   scripts/setup.sh [--lean]
#     --lean   what `scripts/build.sh lean` needs alone (docs/cluster.md)
set -euo pipefail

# One of several that exclude each other, "a|b": a is installed where none of them is.
packages=(
  build-essential cmake ninja-build ccache git ca-certificates pkg-config
  "libtorch-dev|libtorch-cuda-dev" "libgloo-dev|libgloo-cuda-dev" libopenblas0-openmp nlohmann-json3-dev
  libspdlog-dev libcli11-dev libeigen3-dev libzip-dev zlib1g-dev liblemon-dev libnanoflann-dev libstb-dev
)
# Parts of the project that the rest does without: anigen-studio, the Python package, tests of power losses.
optional=()

case ${1:-} in
  --lean) ;;
  '')
    packages+=(
      libopencv-dev libtinygltf-dev libembree-dev libtbb-dev libdraco-dev libmeshoptimizer-dev libassimp-dev libcgal-dev
      libgtest-dev libbenchmark-dev python3-numpy
    )
    optional+=(libcpp-httplib-dev pybind11-dev python3-dev python3-fusepy)
    ;;
  *) echo "setup: no option '$1'; see the head of $0" >&2; exit 2 ;;
esac

installed() { dpkg-query -W -f '${Status}' "$1" 2>/dev/null | grep -q 'ok installed'; }

missing=()
for choice in "${packages[@]}"; do
  found=
  for package in ${choice//|/ }; do
    if installed "$package"; then found=yes; fi
  done
  [ -n "$found" ] || missing+=("${choice%%|*}")
done

wanted=()
for package in "${optional[@]}"; do
  installed "$package" || wanted+=("$package")
done

if [ ${#missing[@]} -gt 0 ] || [ ${#wanted[@]} -gt 0 ]; then
  as_root=()
  if [ "$(id -u)" -ne 0 ]; then
    if command -v sudo >/dev/null; then
      as_root=(sudo)
    elif [ ${#missing[@]} -gt 0 ]; then
      echo "setup: run as root, or install sudo, to install: ${missing[*]}" >&2
      exit 1
    else
      echo "setup: run as root, or install sudo, for what needs ${wanted[*]}" >&2
      wanted=()
    fi
  fi
fi
if [ ${#missing[@]} -gt 0 ] || [ ${#wanted[@]} -gt 0 ]; then
  echo "setup: installing ${missing[*]} ${wanted[*]}"
  "${as_root[@]}" apt-get update -qq
  # Installed packages stay: where one would take the place of another, apt-get stops and names both.
  install() { DEBIAN_FRONTEND=noninteractive "${as_root[@]}" apt-get install -y -qq --no-remove --no-install-recommends "$@" >/dev/null; }
  [ ${#missing[@]} -eq 0 ] || install "${missing[@]}"
  for package in "${wanted[@]}"; do
    install "$package" || echo "setup: $package could not be installed; what needs it is left out"
  done
fi

# LibTorch takes whichever BLAS the alternatives system points to. The OpenMP flavour of OpenBLAS shares LibTorch's
# threads; the reference BLAS is dozens of times slower, and the pthread flavour fights for the same cores.
triplet=$(dpkg-architecture -qDEB_HOST_MULTIARCH)
for library in libblas.so.3 liblapack.so.3 libopenblas.so.0; do
  target=$(update-alternatives --list "$library-$triplet" 2>/dev/null | grep openblas-openmp | head -n 1 || true)
  if [ -n "$target" ] && [ "$(readlink -f "/etc/alternatives/$library-$triplet")" != "$(readlink -f "$target")" ]; then
    if [ "$(id -u)" -eq 0 ]; then
      update-alternatives --quiet --set "$library-$triplet" "$target" >/dev/null
    else
      sudo update-alternatives --quiet --set "$library-$triplet" "$target" >/dev/null || true
    fi
  fi
done

[ "${1:-}" != --lean ] || exit 0

# The Khronos validator checks exported files in the tests, three.js shows assets in reports and, with three-vrm, loads VRM files in the tests. npm is optional: without
# it the checks are skipped, and reports have no 3D views.
root=$(cd "$(dirname "$0")/.." && pwd)
if ! command -v npm >/dev/null && [ ! -d "$root/.cache/node/node_modules/three" ]; then
  echo "setup: npm is not installed: reports and anigen-studio have no 3D views; sudo apt-get install npm, then again"
fi
for package in gltf-validator@2.0.0-dev.3.10 three@0.171.0 @pixiv/three-vrm@3.4.0; do
  if command -v npm >/dev/null && [ ! -d "$root/.cache/node/node_modules/${package%@*}" ]; then
    mkdir -p "$root/.cache/node"
    npm install --silent --no-fund --no-audit --prefix "$root/.cache/node" "$package" >/dev/null 2>&1 ||
      echo "setup: $package could not be installed; the tests and reports do without"
  fi
done
