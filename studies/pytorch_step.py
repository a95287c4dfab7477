"""Time of a training step of the T5-small shape in PyTorch: 16 sequences of 96 in and 40 out, dropout 0.1, AdamW.

    pip install torch transformers
    python pytorch_step.py [steps [threads [cpu|cuda [f32|bf16]]]]

The bench `t5_step` of crates/train does the same; docs/results/training.md has the figures.
"""

import statistics
import sys
import time

import torch
from transformers import T5Config, T5ForConditionalGeneration

VOCAB, BATCH, SOURCE, TARGET = 32128, 16, 96, 40
steps = int(sys.argv[1]) if len(sys.argv) > 1 else 8
torch.set_num_threads(int(sys.argv[2]) if len(sys.argv) > 2 else 1)
torch.manual_seed(1)

device = sys.argv[3] if len(sys.argv) > 3 else "cpu"
half = len(sys.argv) > 4 and sys.argv[4] == "bf16"

config = T5Config(vocab_size=VOCAB, d_model=512, d_kv=64, d_ff=2048, num_layers=6, num_heads=8, dropout_rate=0.1,
                  decoder_start_token_id=0)
model = T5ForConditionalGeneration(config).train().to(device)
optimizer = torch.optim.AdamW(model.parameters(), lr=1e-3, betas=(0.9, 0.99), weight_decay=0.01)


def ids(first, rows, length):
    """The same made-up ids in both programs."""
    return torch.tensor([[(row * 7919 + at * 104729) % (VOCAB - 2) + 2 for at in range(length)]
                         for row in range(first, first + rows)], device=device)


source, target = ids(0, BATCH, SOURCE), ids(BATCH, BATCH, TARGET)
totals = []
for step in range(steps):
    started = time.perf_counter()
    with torch.autocast(device, torch.bfloat16, enabled=half):
        loss = model(input_ids=source, labels=target).loss
    value = loss.item()
    forward = time.perf_counter() - started
    optimizer.zero_grad(set_to_none=True)
    loss.backward()
    backward = time.perf_counter() - started - forward
    torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
    optimizer.step()
    if device == "cuda":
        torch.cuda.synchronize()
    total = time.perf_counter() - started
    print(f"step {step}: loss {value:.4f}, {total:.3f} s = forward {forward:.3f} + backward {backward:.3f} "
          f"+ update {total - forward - backward:.3f}")
    totals.append(total)
print(f"PyTorch {torch.__version__}: median {statistics.median(totals):.3f} s, best {min(totals):.3f} s")
if device == "cuda":
    print(f"peak memory {torch.cuda.max_memory_allocated() / 1e6:.0f} MB")
