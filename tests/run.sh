#!/usr/bin/env bash
# Installs the outside judges and runs the whole suite with every one of them required.
# Usage: tests/run.sh [arguments of the test runner]
# On two cores it takes about 12 minutes once all is built, and the first time about as long again to build; it says so too.
# With TRISPLAT_JUDGES_ONLY set it installs and ends, so that CI can compile beside it.
# With TRISPLAT_PYTHON set it builds and tests the Python module too, which compiles the library once more.
#
# Needs Rust. On Debian and Ubuntu it installs what else is missing with apt, as root or through sudo;
# elsewhere it names it. Judges land in target/judges and nowhere else; when all is there it just tests.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
exec </dev/null

VALIDATOR=2.0.0-dev.3.10
TRIMESH=5.2.0
OPEN3D=0.20.0
JSONSCHEMA=4.26.0
PLAYWRIGHT=1.65.1
F3D=4.0.0
TILES=0.5.3
BABYLON=9.28.0
MATURIN=1.16.0
PUPPETEER=25.16.0
PYCOLMAP=4.2.1
BPY=4.2.21
BPY_NEWEST=5.0.1
USD=26.11
GLTFPACK=1.3.0
GLTF_TRANSFORM=4.5.1
judges=target/judges
python=$judges/venv/bin/python

section() { printf '\n== %s\n' "$*"; }
fail() {
    printf '\ntests/run.sh: %s\n' "$*" >&2
    exit 1
}
has() { command -v "$1" >/dev/null 2>&1; }

# The prefix that makes a command run as root; fails when there is no way.
as_root() {
    if [ "$(id -u)" = 0 ]; then
        env DEBIAN_FRONTEND=noninteractive "$@"
    elif has sudo && sudo -n true 2>/dev/null; then
        sudo -n env DEBIAN_FRONTEND=noninteractive "$@"
    else
        return 1
    fi
}

# apt_install WHY PACKAGE...
apt_install() {
    local why=$1
    shift
    has apt-get || fail "$why: install what your system calls $*"
    echo "installing $* ($why)"
    as_root apt-get install -y --no-install-recommends "$@" >/dev/null 2>&1 && return
    as_root apt-get update >/dev/null 2>&1 || fail "$why: run 'apt-get install $*' as root, or fix apt-get update"
    as_root apt-get install -y --no-install-recommends "$@" >/dev/null || fail "$why: apt-get install $* failed"
}

# judge PACKAGE VERSION [OTHER PACKAGES]: true when the npm package stands at this version among the judges, installed now if need be.
judge() {
    grep -qs "\"version\": \"$2\"" "$judges/node_modules/$1/package.json" && return
    npm install --loglevel=error --no-fund --no-audit --prefix "$judges" "$1@$2" "${@:3}"
}

echo 'the whole suite: about 12 minutes on two cores, and the first time about as long again to build'
section 'tools'
has cargo || fail 'Rust is missing: see https://rustup.rs'
has cc || apt_install 'a linker for Rust, a C++ compiler for meshopt' build-essential
has c++ || apt_install 'a C++ compiler for meshopt' g++
has python3 || apt_install 'Python for trimesh and Open3D' python3 python3-venv
has npm || apt_install 'Node for the glTF validator' nodejs npm
mkdir -p "$judges"

section 'Khronos glTF validator'
judge gltf-validator "$VALIDATOR" || fail 'npm could not install gltf-validator'
echo "gltf-validator $VALIDATOR"

section 'programs that rewrite glTF files'
judge gltfpack "$GLTFPACK" || fail 'npm could not install gltfpack'
judge @gltf-transform/cli "$GLTF_TRANSFORM" || fail 'npm could not install @gltf-transform/cli'
echo "gltfpack $GLTFPACK, glTF-Transform $GLTF_TRANSFORM"

section 'trimesh, Open3D and jsonschema'
# Open3D has a build without CUDA for x86-64 Linux only.
open3d=open3d
if [ "$(uname -sm)" = 'Linux x86_64' ]; then open3d=open3d-cpu; fi
wanted="trimesh==$TRIMESH $open3d==$OPEN3D jsonschema==$JSONSCHEMA"
if [ "$(cat "$judges/venv/wanted" 2>/dev/null)" != "$wanted" ]; then
    rm -rf "$judges/venv"
    # Debian's Python comes without ensurepip until python3-venv is there.
    if ! python3 -m venv "$judges/venv" >/dev/null 2>&1; then
        rm -rf "$judges/venv"
        apt_install 'Python environments' python3-venv
        python3 -m venv "$judges/venv" || /usr/bin/python3 -m venv "$judges/venv" || fail 'python3 -m venv failed'
    fi
    # shellcheck disable=SC2086
    "$python" -m pip install --quiet --disable-pip-version-check 'numpy>=1.26,<3' $wanted ||
        fail "pip could not install $wanted with $("$python" --version)"
    echo "$wanted" >"$judges/venv/wanted"
fi
if ! "$python" -c 'import open3d' 2>/dev/null; then
    apt_install 'libraries of Open3D' libusb-1.0-0 libgomp1 libgl1 libegl1 libx11-6
    "$python" -c 'import open3d' || fail 'Open3D does not load'
fi
echo "$wanted"

section 'packages of the page'
required=gltf-validator,gltfpack,gltf-transform,trimesh,open3d,page
if ! cmp -s page/package-lock.json "$judges/page/package-lock.json"; then
    rm -rf "$judges/page"
    mkdir -p "$judges/page"
    cp page/package.json page/package-lock.json "$judges/page"
    npm ci --silent --no-fund --no-audit --prefix "$judges/page" || {
        rm -rf "$judges/page"
        fail 'npm could not install the packages of page/package-lock.json'
    }
fi
echo "three.js $(sed -n 's/.*"three": "\(.*\)".*/\1/p' page/package.json)"

section 'Chromium'
if ! has chromium && has apt-get; then
    as_root apt-get update >/dev/null 2>&1 || true
    if apt-cache show chromium >/dev/null 2>&1; then apt_install 'pages in a browser' chromium; fi
fi
if has chromium; then
    required=$required,chromium
    judge playwright-core "$PLAYWRIGHT" || fail 'npm could not install playwright-core'
    required=$required,3d-tiles-renderer
    # As the judge it is asked for with the three.js that draws it.
    three=$(sed -n 's/.*"three": "\(.*\)".*/\1/p' page/package.json)
    judge 3d-tiles-renderer "$TILES" "three@$three" || fail 'npm could not install 3d-tiles-renderer'
    # Its packages are released apart from each other, so a registry may have one and not the other.
    if judge babylonjs "$BABYLON" "babylonjs-loaders@$BABYLON"; then
        required=$required,babylon
    else
        rm -rf "$judges/node_modules/babylonjs"
        echo "NOT CHECKED: npm could not install Babylon.js $BABYLON"
    fi
    chromium --version 2>/dev/null
else
    echo 'NOT CHECKED: chromium is not among the packages of this system'
fi

section 'the program as WebAssembly'
if ! has clang-19 && has apt-get && apt-cache show clang-19 >/dev/null 2>&1; then (apt_install 'WebAssembly' clang-19) || true; fi
# Without full optimisation: the same bytes, sooner built.
if web/build.sh quick; then
    required=$required,web
else
    echo 'SKIPPED: web/build.sh could not build it'
fi

section 'Firefox'
if ! has firefox-esr && has apt-get && apt-cache show firefox-esr >/dev/null 2>&1; then
    (apt_install 'the program in another browser' firefox-esr libgl1-mesa-dri xvfb xauth) || true
fi
if has firefox-esr && has xvfb-run && judge puppeteer-core "$PUPPETEER"; then
    required=$required,firefox
    firefox-esr --version
else
    echo 'NOT CHECKED: firefox-esr is not among the packages of this system'
fi

section 'f3d'
if "$python" -m pip install --quiet --disable-pip-version-check "f3d==$F3D" &&
    "$python" -c 'import f3d; f3d.Engine.create(True)' >/dev/null 2>&1; then
    required=$required,f3d
    echo "f3d $F3D"
else
    echo "NOT CHECKED: f3d $F3D has no build for this system, or finds no EGL"
fi

section 'pycolmap'
# Wheels are there for some systems and Pythons only.
if "$python" -m pip install --quiet --disable-pip-version-check "pycolmap==$PYCOLMAP" &&
    "$python" -c 'import pycolmap' >/dev/null 2>&1; then
    required=$required,pycolmap
    echo "pycolmap $PYCOLMAP"
else
    echo "NOT CHECKED: pycolmap $PYCOLMAP has no wheel for this system"
fi

section 'Blender as a Python module'
# Wheels are there for one Python only.
if "$python" -m pip install --quiet --disable-pip-version-check "bpy==$BPY" && "$python" -c 'import bpy' >/dev/null 2>&1; then
    required=$required,bpy
    echo "Blender $BPY"
else
    echo "NOT CHECKED: bpy $BPY has no wheel for this system, or lacks a library"
fi
# One environment has one Blender.
newest=$judges/bpy
if { [ -x $newest/bin/python ] || "$python" -m venv $newest; } &&
    $newest/bin/python -m pip install --quiet --disable-pip-version-check "bpy==$BPY_NEWEST" && $newest/bin/python -c 'import bpy' >/dev/null 2>&1; then
    required=$required,bpy-newest
    echo "Blender $BPY_NEWEST"
else
    echo "NOT CHECKED: bpy $BPY_NEWEST has no wheel for this system, or lacks a library"
fi

section 'USD'
# Wheels are there for some systems and Pythons only.
if "$python" -m pip install --quiet --disable-pip-version-check "usd-core==$USD" && "$python" -c 'import pxr.UsdValidation' 2>/dev/null; then
    required=$required,pxr
    echo "usd-core $USD"
else
    echo "NOT CHECKED: usd-core $USD has no wheel for this system"
fi

section 'software Vulkan and a virtual screen'
if has apt-get; then
    ls /usr/share/vulkan/icd.d/lvp_icd*.json >/dev/null 2>&1 ||
        apt_install 'a graphics card in software' mesa-vulkan-drivers libvulkan1
    if ! has Xvfb || ! has xdotool || ! has import; then
        apt_install 'windows without a screen' xvfb xdotool imagemagick libxkbcommon-x11-0
    fi
fi
export TRISPLAT_REQUIRE_GPU=1

section 'Godot 3'
if ! has godot3-server && has apt-get; then
    as_root apt-get update >/dev/null 2>&1 || true
    if apt-cache show godot3-server >/dev/null 2>&1; then apt_install 'import by an engine' godot3-server; fi
fi
if has godot3-server; then
    required=$required,godot3
    godot3-server --version || true # exits with 255 when all is well
else
    echo 'NOT CHECKED: godot3-server is not among the packages of this system'
fi

# By tests/judges/godot4.sh.
if [ -x "$judges/godot4" ]; then required=$required,godot4; fi
if [ -x "$judges/godot4-screen" ]; then required=$required,godot4-screen; fi

section 'a compiler for C#'
json=/usr/lib/mono/gac/System.Runtime.Serialization
if ! { has mcs && [ -e $json ]; } && has apt-get && apt-cache show mono-mcs >/dev/null 2>&1; then
    (apt_install 'scripts for Unity' mono-mcs libmono-system-runtime-serialization4.0-cil) || true
fi
if has mcs && [ -e $json ]; then
    required=$required,mcs
    mcs --version
else
    echo 'NOT CHECKED: mono-mcs is not among the packages of this system'
fi

if [ -n "${TRISPLAT_PYTHON:-}" ]; then
    section 'maturin and notebooks'
    "$python" -m pip install --quiet --disable-pip-version-check "maturin==$MATURIN" nbclient ipykernel pillow ||
        fail "pip could not install maturin $MATURIN and what runs a notebook"
    echo "maturin $MATURIN"
fi

if [ -n "${TRISPLAT_JUDGES_ONLY:-}" ]; then exit; fi
section 'examples in the documentation'
cargo test --workspace --doc --all-features || fail 'examples failed'
section 'suite'
export TRISPLAT_REQUIRE_JUDGES=$required
if cargo nextest --version >/dev/null 2>&1; then
    cargo nextest run --workspace --all-features "$@" || fail 'tests failed'
else
    echo 'cargo-nextest is not installed: cargo test does the same, slower'
    cargo test --workspace --all-features --lib --bins --tests "$@" || fail 'tests failed'
fi
printf '\nall passed; judges: %s\n' "$required"
