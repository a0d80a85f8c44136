#!/usr/bin/env bash
# Builds the project and runs its unit and parity tests on Debian 13 (LibTorch 2.6, Embree 4) inside a folder made
# by debootstrap; needs root. The folder is kept, so a second run only rebuilds.
#   scripts/debian13.sh [folder, default /var/tmp/anigen-debian13]
set -euo pipefail
cd "$(dirname "$0")/.."
root=${1:-/var/tmp/anigen-debian13}
[ "$(id -u)" -eq 0 ] || { echo "debian13: run as root (debootstrap and chroot need it)" >&2; exit 1; }
command -v debootstrap >/dev/null || { apt-get update -qq; apt-get install -y -qq --no-install-recommends debootstrap; }

# The mirror that this machine's own apt uses for Debian's main archive.
mirror=$(apt-get indextargets --format '$(REPO_URI) $(ORIGIN) $(LABEL)' | awk '$2 == "Debian" && $3 == "Debian" { print $1; exit }')
[ -n "$mirror" ] || { echo "debian13: no Debian mirror in apt's configuration" >&2; exit 1; }

if [ ! -e "$root/.bootstrapped" ]; then
  debootstrap --variant=minbase trixie "$root" "$mirror"
  touch "$root/.bootstrapped"
fi
mkdir -p "$root/project/anigen" "$root/project/shared" "$root/root/.ccache"
mounted=()
cleanup() { for target in "${mounted[@]}"; do umount "$target" || true; done; }
trap cleanup EXIT
bind() { mount --bind "$1" "$2"; mounted=("$2" "${mounted[@]}"); }
bind /proc "$root/proc"
bind /dev "$root/dev"
# A copy, so that build folders of the two systems stay apart.
git ls-files -z --cached --others --exclude-standard | while IFS= read -r -d '' file; do if [ -e "$file" ]; then printf '%s\0' "$file"; fi; done |
  tar --null -T - -cf - | tar -C "$root/project/anigen" -xf -
[ -d ../shared ] && bind ../shared "$root/project/shared"
cp /etc/resolv.conf "$root/etc/resolv.conf"
chroot "$root" /usr/bin/env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 \
  bash -c 'cd /project/anigen && scripts/test.sh release -L "unit|parity"'
