#!/usr/bin/env bash
# Builds the wheel of the Python package into dist/ (or the folder named): one file for Python 3.10 and newer.
#
#   scripts/wheels.sh [FOLDER]
#
# Needs Rust and maturin (`pip install maturin`). With ziglang (`pip install ziglang`) the wheel runs on any Linux with
# glibc 2.28 or newer; without it, on those with the glibc of this machine. TARGET names another target of rustup, for
# example aarch64-unknown-linux-gnu. FEATURES=train adds training to the command of the package. SIMD is chosen at run time, so one wheel serves all processors of a target.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-dist}

if ! command -v maturin >/dev/null; then
    echo "wheels.sh: maturin is missing" >&2
    echo "hint: pip install maturin" >&2
    exit 1
fi
options=(--release --locked --out "$out")
if [ -n "${FEATURES:-}" ]; then
    options+=(--features "$FEATURES")
fi
if [ -n "${TARGET:-}" ]; then
    options+=(--target "$TARGET")
fi
if [ "$(uname -s)" = Linux ]; then
    if python3 -m ziglang version >/dev/null 2>&1; then
        options+=(--zig --compatibility manylinux_2_28)
    else
        echo "wheels.sh: no ziglang, the wheel needs this machine's glibc" >&2
    fi
fi
maturin build "${options[@]}"
ls -l "$out"/*.whl
