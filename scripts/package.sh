#!/bin/sh
# Packs the library and the crates that it links, as a registry would receive them, into target/package. They depend on
# one another, so that they are packed together. Needs no network; `--no-verify` because the packages would be built
# once more.
set -eu
cd "$(dirname "$0")/.."
packages=$(cargo tree --locked --offline -p radarllm -e normal,build --prefix none |
    awk '/^radarllm/ { print "-p " $1 }' | sort -u)
# shellcheck disable=SC2086 # words on purpose
cargo package --locked --offline --no-verify $packages "$@"
