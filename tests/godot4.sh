#!/usr/bin/env bash
# Installs Godot 4 as one more judge; from then on tests/run.sh asks it too. Usage: tests/godot4.sh
#
# Stable Debian has no Godot 4, so this makes a root folder of Debian's development branch below
# target/judges: as root, on Debian, in about a minute and 700 MB. Not part of CI, as that branch moves.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
exec </dev/null
export DEBIAN_FRONTEND=noninteractive
judges=$PWD/target/judges
root=$judges/sid

[ "$(id -u)" = 0 ] || { echo 'tests/godot4.sh: needs root (chroot)' >&2; exit 1; }
if ! [ -x "$root/usr/bin/godot" ]; then
    apt-get install -y --no-install-recommends debootstrap >/dev/null
    mirror=$(apt-get indextargets --format '$(SITE)' 'Created-By: Packages' | grep '/debian$' | head -n 1)
    rm -rf "$root"
    mkdir -p "$root"
    debootstrap --variant=minbase sid "$root" "$mirror" >"$judges/godot4.log"
    chroot "$root" apt-get install -y --no-install-recommends godot >>"$judges/godot4.log"
    chroot "$root" apt-get clean
fi

# godot4 PROJECT [ARGUMENTS]: Godot on a folder, which is moved into its root and back.
cat >"$judges/godot4" <<EOF
#!/bin/sh
set -e
project=\$(realpath "\$1"); shift
inside=\$(mktemp -d "$root/tmp/project.XXXXXX")
trap 'rm -rf "\$inside"' EXIT
cp -a "\$project/." "\$inside"
chroot "$root" env HOME=/tmp godot --headless --path "/tmp/\${inside##*/}" "\$@" </dev/null
cp -a "\$inside/." "\$project"
EOF
chmod +x "$judges/godot4"
chroot "$root" godot --version
