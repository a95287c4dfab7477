#!/bin/sh
# Writes radarllm.cdx.json, the CycloneDX list of the packages from which the command `radarllm` is built:
#
#   scripts/sbom.sh [FILE]
#
# Needs cargo-cyclonedx (`cargo install --locked cargo-cyclonedx@0.5.9`). The same commit gives the same bytes: the date is
# that of the commit, there is no serial number then, and paths begin in the repository.
# Listed is what Cargo.lock and the features can bring to this target: all that `cargo tree -e normal,build` names, and a few
# packages that no feature in use links.
set -eu
cd "$(dirname "$0")/.."
out=${1:-radarllm.cdx.json}
command -v cargo-cyclonedx > /dev/null || {
    echo "scripts/sbom.sh: cargo-cyclonedx is not installed: cargo install --locked cargo-cyclonedx@0.5.9" >&2
    exit 1
}
name=radarllm-sbom.tmp
# It writes a list beside every manifest of the workspace that has a binary.
trap 'rm -f crates/*/"$name".json' EXIT
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct) cargo cyclonedx --quiet --format json --spec-version 1.5 \
    --manifest-path crates/cli/Cargo.toml --override-filename "$name"
sed "s|file://$PWD/|file:///|g" "crates/cli/$name.json" > "$out"
