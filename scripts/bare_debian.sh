# A bare Debian in a folder, made by debootstrap, with a copy of this checkout; sourced by scripts/debian13.sh and
# scripts/lean.sh, which run as root in the checkout. What is mounted goes when the script ends.
#   enter SUITE FOLDER          makes it once, and mounts what programs in it need
#   copy_checkout FOLDER        into FOLDER, without its history, so that programs name no commit; build folders stay
#   inside FOLDER COMMAND       runs bash there
[ "$(id -u)" -eq 0 ] || { echo "$(basename "$0"): run as root (debootstrap and chroot need it)" >&2; exit 1; }
command -v debootstrap >/dev/null || { apt-get update -qq; apt-get install -y -qq --no-install-recommends debootstrap; }

# The mirror that this machine's own apt uses for Debian's main archive.
mirror=$(apt-get indextargets --format '$(REPO_URI) $(ORIGIN) $(LABEL)' | awk '$2 == "Debian" && $3 == "Debian" { print $1; exit }')
[ -n "$mirror" ] || { echo "$(basename "$0"): no Debian mirror in apt's configuration" >&2; exit 1; }

mounted=()
cleanup() { for target in "${mounted[@]}"; do umount "$target" || true; done; }
trap cleanup EXIT
bind() { mount --bind "$1" "$2"; mounted=("$2" "${mounted[@]}"); }
enter() {
  [ -e "$2/.bootstrapped" ] || { debootstrap --variant=minbase "$1" "$2" "$mirror" && touch "$2/.bootstrapped"; }
  bind /proc "$2/proc"
  bind /dev "$2/dev"
  cp /etc/resolv.conf "$2/etc/resolv.conf"
}
copy_checkout() {
  mkdir -p "$1"
  git ls-files -z --cached --others --exclude-standard | while IFS= read -r -d '' file; do if [ -e "$file" ]; then printf '%s\0' "$file"; fi; done |
    tar --null -T - -cf - | tar -C "$1" -xf -
}
inside() { local at=$1; shift; chroot "$at" /usr/bin/env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 bash -ec "$@"; }
