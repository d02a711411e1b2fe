#!/usr/bin/env bash
# Builds trisplat for pages and scripts (docs/web.md): target/web/npm, the package, and target/web/app, the page.
# Usage: web/build.sh [PROFILE]   (PROFILE of cargo: release unless given)
# Needs the target (rustup adds it), clang 16 or later for meshopt's C++, and Node with the packages of page/package-lock.json.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
profile=${1:-release}
target=wasm32-wasip1-threads
out=target/web

fail() {
    printf 'web/build.sh: %s\n' "$*" >&2
    exit 1
}

rustup target list --installed 2>/dev/null | grep -qx "$target" || rustup target add "$target" >/dev/null 2>&1 ||
    fail "rustup could not install $target"
# Any clang knows WebAssembly; those before 16 do not know this system by its name.
clang=
for name in "${CLANG:-clang}" clang-{22,21,20,19,18,17,16}; do
    version=$("$name" -dumpversion 2>/dev/null | cut -d. -f1) || continue
    if [ "${version:-0}" -ge 16 ]; then
        clang=$name
        break
    fi
done
[ -n "$clang" ] || fail 'clang 16 or later is missing: on Debian, apt-get install clang-19'

# pytorch-reader asks for a second handle of its file, which std has not here; opening the file anew is the same, as nothing replaces it.
patched=target/web-patched
if [ ! -f "$patched/done" ]; then
    crate=$(cargo metadata --locked --format-version 1 | node -p '
        JSON.parse(require("fs").readFileSync(0)).packages.find(({ name }) => name === "pytorch-reader").manifest_path')
    asks='BufReader::new(file.try_clone()?)'
    grep -qF "$asks" "$(dirname "$crate")/src/storage.rs" || fail "pytorch-reader has changed: $asks is not in its src/storage.rs"
    rm -rf "$patched"
    mkdir -p "$patched"
    cp -r "$(dirname "$crate")" "$patched/pytorch-reader"
    sed -i.old 's/BufReader::new(file\.try_clone()?)/BufReader::new(File::open(path)?)/' "$patched/pytorch-reader/src/storage.rs"
    touch "$patched/done"
fi

# meshopt brings headers for WebAssembly that leave out what it does not call there; what our system's library has is named here.
math=
for name in floorf ceilf log2f frexpf ldexpf cosf; do math="$math -D$name=__builtin_$name"; done
env "CC_${target//-/_}=$clang" "CXX_${target//-/_}=$clang" "AR_${target//-/_}=${AR:-ar}" \
    "CFLAGS_${target//-/_}=$math" "CXXFLAGS_${target//-/_}=$math" \
    cargo build --locked --config "paths=['$PWD/$patched/pytorch-reader']" --profile "$profile" --target "$target" --no-default-features --features web --bin trisplat-web
folder=$profile
if [ "$profile" = dev ]; then folder=debug; fi

rm -rf "$out"
mkdir -p "$out/npm"
node web/strip.mjs "target/$target/$folder/trisplat-web.wasm" "$out/npm/trisplat.wasm"
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
sed "s/\"version\": .*/\"version\": \"$version\",/" web/package.json >"$out/npm/package.json"
cp web/src/*.js web/src/index.d.ts web/README.md web/example.mjs LICENSE-* "$out/npm"
modules=page
if [ -d target/judges/page/node_modules ]; then modules=target/judges/page; fi
[ -d "$modules/node_modules" ] || npm ci --silent --no-fund --no-audit --prefix "$modules" ||
    fail 'npm could not install the packages of page/package-lock.json'
node page/app/build.mjs "$out/npm/trisplat.wasm" "$out/app" "$modules"
