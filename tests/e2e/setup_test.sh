#!/usr/bin/env bash
# scripts/setup.sh on machines that are made up: setup_test.sh CHECKOUT. The programs that it calls are replaced by ones
# that answer from a list of installed packages and write down what they are asked to do.
set -euo pipefail
setup=$1/scripts/setup.sh
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
failed=0

mkdir "$work/bin" "$work/checkout" "$work/checkout/scripts"
cp "$setup" "$work/checkout/scripts/"  # what it installs by npm goes beside it
cat > "$work/bin/dpkg-query" <<'SCRIPT'
#!/bin/bash
if grep -qx "${!#}" "$(dirname "$0")/../installed"; then echo -n 'install ok installed'; else exit 1; fi
SCRIPT
cat > "$work/bin/apt-get" <<'SCRIPT'
#!/bin/bash
echo "$*" >> "$(dirname "$0")/../asked"
SCRIPT
printf '#!/bin/bash\necho x86_64-linux-gnu\n' > "$work/bin/dpkg-architecture"
printf '#!/bin/bash\nexit 0\n' > "$work/bin/update-alternatives"
printf '#!/bin/bash\n[ "$*" = -u ] && echo 0 || exec /usr/bin/id "$@"\n' > "$work/bin/id"
printf '#!/bin/bash\nexit 1\n' > "$work/bin/npm"
chmod +x "$work"/bin/*

run() {  # installed packages
  printf '%s\n' "$@" > "$work/installed"
  : > "$work/asked"
  PATH="$work/bin:$PATH" bash "$work/checkout/scripts/setup.sh" >"$work/said" 2>&1 || { echo "FAILED: setup.sh"; cat "$work/said"; failed=1; }
}
asked() { grep -qE "(^| )$1( |\$)" "$work/asked"; }
expect() {  # sentence, command …
  local what=$1
  shift
  if ! "$@"; then
    echo "FAILED: $what"
    cat "$work/asked"
    failed=1
  fi
}
not() { ! "$@"; }

run nothing-yet
expect 'a bare machine gets libtorch-dev' asked libtorch-dev
expect 'a bare machine gets libgloo-dev' asked libgloo-dev
expect 'nothing may be removed' grep -q -- '--no-remove' "$work/asked"

# Debian's CUDA build of LibTorch conflicts with the other one: apt would remove it.
run libtorch-cuda-dev libgloo-cuda-dev
expect 'libtorch-cuda-dev stays' not asked libtorch-dev
expect 'libgloo-cuda-dev stays' not asked libgloo-dev
expect 'the rest is installed' asked libopencv-dev

run libtorch-cuda-dev
expect 'libtorch-cuda-dev stays' not asked libtorch-dev
expect 'libgloo-dev is installed where no other one is' asked libgloo-dev

# With everything there, apt is not called.
run nothing-yet
all=$(tr ' ' '\n' < "$work/asked" | grep -E '^(lib|build-|cmake|ninja|ccache|git|ca-|pkg|nlohmann|zlib|python|pybind)')
run $all
expect 'nothing is missing, so nothing is asked' test ! -s "$work/asked"

[ "$failed" -eq 0 ] && echo 'setup.sh: ok'
exit "$failed"
