# What `.ci/run` and `.ci/more` share; they source it.
# Compiled once and never again: fewer, larger units of code, and no debug information (panics name their line without it).
export CARGO_INCREMENTAL=0 CARGO_PROFILE_DEV_DEBUG=0

step() {
    local began=$SECONDS
    printf '\n-- %s (after %d s)\n' "$*" "$began"
    "$@"
    printf -- '-- %d s: %s\n' $((SECONDS - began)) "$*"
}

# component NAME: true when `cargo NAME` runs, installed now if need be.
component() {
    cargo "$1" --version >/dev/null 2>&1 && return
    rustup component add "$2" >/dev/null 2>&1 && return
    printf '\nSKIPPED (no cargo %s, and rustup could not install %s)\n' "$1" "$2" >&2
    return 1
}

# target NAME: true when code for this system can be compiled, installed now if need be.
target() {
    rustup target list --installed 2>/dev/null | grep -qx "$1" && return
    rustup target add "$1" >/dev/null 2>&1 && return
    printf '\nSKIPPED (%s: rustup could not install the target)\n' "$1" >&2
    return 1
}

# other_system TARGET: checks the code for a system that is not this one. Nothing is linked, so what C++ there is
# (meshopt) need not be compiled: `true` stands for the compiler of that system.
other_system() {
    local name=${1//-/_}
    step env "CC_$name=true" "CXX_$name=true" "AR_$name=true" SDKROOT=/ CARGO_TARGET_DIR=target/other \
        cargo clippy --quiet --target "$1" --lib --bins -- -D warnings
}
