#!/usr/bin/env bash
# Installs Godot 4 as one more judge; from then on tests/run.sh asks it too. Usage: tests/judges/godot4.sh
#
# Stable Debian has no Godot 4, so this makes a root folder of Debian's development branch below target/judges: as root, on Debian, in one to
# three minutes and 1 GB, with a graphics card and a screen in software. Not part of CI, as that branch moves.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
exec </dev/null
export DEBIAN_FRONTEND=noninteractive
judges=$PWD/target/judges
root=$judges/sid

[ "$(id -u)" = 0 ] || { echo 'tests/judges/godot4.sh: needs root (chroot)' >&2; exit 1; }
if ! [ -x "$root/usr/bin/godot" ]; then
    apt-get install -y --no-install-recommends debootstrap >/dev/null
    mirror=$(apt-get indextargets --format '$(SITE)' 'Created-By: Packages' | grep '/debian$' | head -n 1)
    rm -rf "$root"
    mkdir -p "$root"
    debootstrap --variant=minbase sid "$root" "$mirror" >"$judges/godot4.log"
    chroot "$root" apt-get install -y --no-install-recommends godot >>"$judges/godot4.log"
    chroot "$root" apt-get clean
fi
if ! [ -x "$root/usr/bin/xvfb-run" ]; then
    chroot "$root" apt-get install -y --no-install-recommends \
        xvfb xauth mesa-vulkan-drivers libvulkan1 libgl1-mesa-dri libgl1 libegl1 libgles2 >>"$judges/godot4.log"
    chroot "$root" apt-get clean
fi

# judge NAME COMMAND: makes `NAME PROJECT [ARGUMENTS]`, Godot on a folder, which is moved into its root and back.
judge() {
    cat >"$judges/$1" <<EOF
#!/bin/sh
set -e
project=\$(realpath "\$1"); shift
inside=\$(mktemp -d "$root/tmp/project.XXXXXX")
trap 'rm -rf "\$inside"' EXIT
cp -a "\$project/." "\$inside"
chroot "$root" env HOME=/tmp $2 --path "/tmp/\${inside##*/}" "\$@" </dev/null
cp -a "\$inside/." "\$project"
EOF
    chmod +x "$judges/$1"
}
judge godot4 'godot --headless'
# With a window, so that it draws.
judge godot4-screen "xvfb-run -a -s '-screen 0 1280x1024x24 +extension GLX' godot --audio-driver Dummy"
chroot "$root" godot --version
