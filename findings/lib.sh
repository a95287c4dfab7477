# Sourced by every finding: a temporary folder with a virtual environment, which is removed at the end.
#
#   need PROGRAM...            exits with 77 (not run) if a program is missing
#   install PACKAGE==VERSION   installs from PyPI; exits with 77 if that fails, for example without a network
#   observe < PROGRAM          runs a Python program with `finding.report` in reach
#
# PYTHON names the interpreter (default: python3). The pinned versions have wheels for Python 3.11.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

not_run() {
    echo "not run: $1"
    exit 77
}

need() {
    local program
    for program in "$@"; do
        command -v "$program" > /dev/null || not_run "$program is not installed"
    done
}

install() {
    "${PYTHON:-python3}" -m venv "$folder/venv" || not_run "no virtual environment can be made"
    "$folder/venv/bin/pip" install --quiet --no-compile --disable-pip-version-check --retries 1 --timeout 20 "$@" \
        > "$folder/pip.log" 2>&1 || not_run "the packages cannot be installed: $(tail -n 1 "$folder/pip.log")"
    echo "version:  python $("$folder/venv/bin/python" -c 'import platform; print(platform.python_version())'), $*"
    cat > "$folder/finding.py" <<'PYTHON'
import sys


def report(expected, observed, recorded):
    """Prints what a good engineer would guess and what was seen; exits with 1 if that is not what was recorded.

    `observed` and `recorded` are lists of lines.
    """
    print(f"expected: {expected}")
    for line in observed:
        print(f"observed: {line}")
    if observed != recorded:
        for line in recorded:
            if line not in observed:
                print(f"recorded: {line}")
        print("CHANGED: the observation is not the recorded one")
        sys.exit(1)
PYTHON
}

observe() {
    cat > "$folder/program.py"
    (cd "$folder" && MPLBACKEND=Agg venv/bin/python -W ignore program.py)
}
