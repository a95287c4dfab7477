"""Trains every stage at a small size on the CPU and on a graphics processor, and compares their logs.

    python studies/gpu.py RADARLLM [DEVICE [FOLDER]]

RADARLLM is a program built with the feature `gpu`, `libtorch` or `cuda`, DEVICE what `train --device` takes (`gpu`), FOLDER where the data set and the
trainings go (`work/gpu`). The same seeds give the same batches, weights and dropout, so the losses differ by rounding alone; prints the largest
relative differences, and fails above 1e-3. On a software driver compiling the kernels takes minutes a stage; CUBECL_AUTOTUNE_LEVEL=minimal helps.
"""

import json
import subprocess
import sys
from pathlib import Path

DATA = """name = "gpu"
seed = 5
radar = "awr1843boost"
train_variants = 1
facet_edge_m = 0.03
max_frames = 48
[[source]]
kind = "procedural"
train = 40
val = 4
test = 2
"""
LOOP = """
[{stage}.loop]
epochs = 0
max_steps = {steps}
log_every = 1
validate_every = 1000
"""
RECIPE = """data = "data"
out = "{out}"
[motion]
batch_size = 8
model = {{ width = 32, codebook_size = 64 }}
codebook = {{ init_after = 2, init_inputs_per_code = 2 }}
[tokenizer]
batch_size = 4
model = {{ layers = 1, width = 32, code_dim = 32, codebook_size = 64 }}
codebook = {{ init_after = 2, init_inputs_per_code = 1 }}
[pretrain]
preset = "tiny"
batch = 4
[instruct]
batch = 4
"""
STAGES = {"motion": 12, "tokenizer": 20, "pretrain": 15, "instruct": 5}
MOST = 1e-3

program = str(Path(sys.argv[1]).resolve())
device = sys.argv[2] if len(sys.argv) > 2 else "gpu"
folder = Path(sys.argv[3] if len(sys.argv) > 3 else "work/gpu")


def run(*arguments):
    subprocess.run([program, *arguments], cwd=folder, check=True)


def log(out, stage):
    with open(folder / out / stage / "log.jsonl") as lines:
        return [json.loads(line) for line in lines]


folder.mkdir(parents=True, exist_ok=True)
(folder / "data.toml").write_text(DATA)
run("dataset", "build", "data.toml", "--out", "data", "--force")
for out, processor in [("cpu", "cpu"), ("processor", device)]:
    loops = "".join(LOOP.format(stage=stage, steps=steps) for stage, steps in STAGES.items())
    (folder / f"{out}.toml").write_text(RECIPE.format(out=out) + loops)
    run("train", "all", f"{out}.toml", "--device", processor, "--force")

worst = 0.0
for stage, steps in STAGES.items():
    losses, norms = 0.0, 0.0
    cpu, processor = log("cpu", stage), log("processor", stage)
    if len(cpu) != len(processor):
        sys.exit(f"{stage}: {len(processor)} log lines on {device}, {len(cpu)} on the CPU")
    for ours, theirs in zip(cpu, processor):
        for name, value in ours.items():
            if not isinstance(value, float) or name in ("seconds", "items_per_s") or value == 0.0:
                continue
            difference = abs(theirs[name] / value - 1)
            if name == "gradient_norm":
                norms = max(norms, difference)
            else:
                losses = max(losses, difference)
    print(f"{stage:9} {steps:2} updates: losses and scores within {losses:.1e}, gradient norms within {norms:.1e}")
    worst = max(worst, losses, norms)
sys.exit(worst > MOST)
