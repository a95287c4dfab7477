#!/usr/bin/env bash
# What continuous integration leaves out of the Python package, because it takes long or needs large packages: the wheel in
# an empty environment of each Python, PyTorch, Ray, Hugging Face datasets without the network, and measurements. It prints
# what docs/guides/python.md lists under "What was verified".
#
#   scripts/python-check.sh [STEP ...]
#
# Steps: wheel, empty, tests, torch, ray, datasets, measure, train, scaling, side-by-side; all of them if none is named.
# Needs Pythons of versions 3.10 and newer (python3.10, python3.11, ...), a package index, and 8 GB of disk in WORK
# (/tmp/radarllm-python if not set), which is kept for the next run. Steps after `wheel` use the wheel in dist/.
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD
work=${WORK:-/tmp/radarllm-python}
mkdir -p "$work"
export PYTHONDONTWRITEBYTECODE=1 RAY_USAGE_STATS_ENABLED=0

pythons() {
    for version in 3.10 3.11 3.12 3.13 3.14; do
        "python$version" -c 'import venv' 2>/dev/null && echo "$version"
    done
    true
}

# An environment with everything, of the newest Python that Ray has wheels for.
full() {
    if [ ! -x "$work/full/bin/python" ]; then
        for version in 3.13 3.12 3.11; do
            if "python$version" -c 'import venv' 2>/dev/null; then
                "python$version" -m venv "$work/full"
                break
            fi
        done
        "$work/full/bin/pip" install --quiet pytest mypy nbclient nbformat ipykernel pyarrow polars datasets torch 'ray[data]'
    fi
    "$work/full/bin/pip" install --quiet --no-deps --force-reinstall "$root"/dist/radarllm-*.whl
}

tests() {
    (cd "$work" && "$work/full/bin/python" -m pytest -q -rs -p no:cacheprovider -c "$root/pyproject.toml" "$@")
}

data() {
    full
    [ -f "$work/small/manifest.json" ] || "$work/full/bin/radarllm" dataset build "$root/examples/small-data.toml" --out "$work/small"
}

step_wheel() {
    [ -x "$work/build/bin/python" ] || python3 -m venv "$work/build"
    "$work/build/bin/pip" install --quiet maturin ziglang auditwheel
    PATH="$work/build/bin:$PATH" scripts/wheels.sh dist
    "$work/build/bin/auditwheel" show dist/radarllm-*.whl
}

# `pip install` into empty environments, the demo, the README's block.
step_empty() {
    sed -n '/^```python$/,/^```$/p' README.md | sed '1d;/^```$/,$d' > "$work/readme.py"
    for version in $(pythons); do
        rm -rf "$work/empty"
        "python$version" -m venv "$work/empty"
        "$work/empty/bin/pip" install --quiet dist/radarllm-*.whl
        "$work/empty/bin/pip" list 2>/dev/null | tail -n +3 | tr -s ' \n' ' '
        SECONDS=0
        "$work/empty/bin/radarllm" demo > "$work/demo.txt"
        demo=$SECONDS
        SECONDS=0
        "$work/empty/bin/python" "$work/readme.py" > "$work/readme.txt"
        echo; echo "Python $version: demo $demo s, README's block $SECONDS s: $(tail -1 "$work/readme.txt")"
    done
}

step_tests() {
    full
    tests "$root/python/tests" --ignore "$root/python/tests/test_torch.py" --ignore "$root/python/tests/test_ray.py"
}

step_torch() {
    full
    tests "$root/python/tests/test_torch.py"
}

step_ray() {
    full
    tests "$root/python/tests/test_ray.py"
}

# The built folder and its copy load without the network; a changed byte ends the copy.
step_datasets() {
    data
    rm -rf "$work/hub" "$work/changed" "$work/none"
    "$work/full/bin/radarllm" dataset export "$work/small" --to "$work/hub"
    HF_HOME="$work/huggingface" HF_HUB_OFFLINE=1 HF_DATASETS_OFFLINE=1 "$work/full/bin/python" - "$work/small" "$work/hub" <<'EOF'
import sys
import datasets
datasets.disable_progress_bars()
ours, copy = (datasets.load_dataset(folder) for folder in sys.argv[1:])
print(f"datasets {datasets.__version__}:", {split: len(rows) for split, rows in ours.items()}, ours["train"].features["points"])
print("rows of the copy:", "the same" if all(ours[s].to_list() == copy[s].to_list() for s in ours) else "different")
EOF
    cp -a "$work/small" "$work/changed"
    shard=$(ls "$work"/changed/data/train-*.parquet | head -1)
    printf 'x' | dd of="$shard" bs=1 seek=5000 conv=notrunc status=none
    code=0
    "$work/full/bin/radarllm" dataset export "$work/changed" --to "$work/none" || code=$?
    echo "export of a changed byte: exit $code, $([ -e "$work/none" ] && echo something || echo nothing) was copied"
    rm -rf "$work/changed"
}

step_measure() {
    data
    "$work/full/bin/python" python/measure.py "$work/small"
}

step_train() {
    data
    "$work/full/bin/python" examples/train_torch.py "$work/small"
}

step_scaling() {
    full
    "$work/full/bin/python" studies/scaling.py
}

step_side-by-side() {
    [ -x "$work/xwr/bin/python" ] || python3 -m venv "$work/xwr"
    "$work/xwr/bin/pip" install --quiet xwr==0.5.1
    "$work/xwr/bin/pip" install --quiet --no-deps --force-reinstall dist/radarllm-*.whl
    "$work/xwr/bin/python" studies/side_by_side.py
}

[ $# -gt 0 ] || set -- wheel empty tests torch ray datasets measure train scaling side-by-side
for step in "$@"; do
    declare -F "step_$step" > /dev/null || { echo "python-check.sh: no step $step" >&2; exit 1; }
    echo "== $step"
    "step_$step"
done
