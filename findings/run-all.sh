#!/usr/bin/env bash
# Runs every finding in this folder, or those that are named, and prints a table of passed, changed and not run.
#
#   findings/run-all.sh [NAME...]
#
# The exit code is 1 if an observation changed. "not run" (no network, a missing program) does not fail.
set -euo pipefail
cd "$(dirname "$0")"
logs=$(mktemp -d)
trap 'rm -rf "$logs"' EXIT

names=("$@")
if [ "$#" -eq 0 ]; then
    for script in *.sh; do
        case $script in lib.sh | run-all.sh) ;; *) names+=("${script%.sh}") ;; esac
    done
fi

changed=0
for name in "${names[@]}"; do
    code=0
    bash "$name.sh" > "$logs/$name" 2>&1 || code=$?
    case $code in
        0) result=passed why="" ;;
        77) result="not run" why=$(tail -n 1 "$logs/$name") ;;
        *) result=changed why="" changed=1 ;;
    esac
    printf '%-8s  %-32s %s\n' "$result" "$name" "${why#not run: }"
    if [ "$result" = changed ]; then sed 's/^/    /' "$logs/$name"; fi
done
exit "$changed"
