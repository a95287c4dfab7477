"""Learns to describe radar clips, from nothing: `python train_torch.py DATA_SET [SECONDS]`; needs torch."""

import random
import sys
import time
from collections import Counter

import torch
from torch import nn
from torch.nn.utils.rnn import pack_padded_sequence, pad_sequence

import radarllm as rl
from radarllm.torch import RadarText

folder = sys.argv[1]
seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 110.0
torch.manual_seed(1)
random.seed(1)

sentences = [c for b in rl.batches(folder) for captions in b.captions for c in captions]
words = ["<end>", *sorted({word for sentence in sentences for word in sentence.split()})]
index = {word: i for i, word in enumerate(words)}
scale = torch.tensor([1.0, 3.0, 1.0, 3.0, 1.0, 60.0])  # of x, y, z, range, velocity, intensity


class Captioner(nn.Module):
    def __init__(self, n: int = 160) -> None:
        super().__init__()
        self.point = nn.Sequential(nn.Linear(6, n), nn.ReLU(), nn.Linear(n, n), nn.ReLU())
        self.word = nn.Embedding(len(words), n)
        self.listen, self.speak = nn.GRU(n, n, batch_first=True), nn.GRU(n, n, batch_first=True)
        self.next = nn.Linear(n, len(words))

    def hear(self, b):
        """What is heard of clips: the strongest features of the points of a frame, then the frames in order."""
        frames = (self.point(b["points"] / scale) * b["mask"][..., None]).amax(2)
        return self.listen(pack_padded_sequence(frames, b["lengths"], batch_first=True, enforce_sorted=False))[1]

    def describe(self, b) -> list[str]:
        word, heard, found = torch.zeros(len(b["ids"]), 1, dtype=torch.long), self.hear(b), []
        for _ in range(25):
            out, heard = self.speak(self.word(word), heard)
            word = self.next(out).argmax(-1)
            found.append(word)
        return [" ".join(words[w] for w in row).split("<end>")[0].strip() for row in torch.cat(found, 1).tolist()]


# The training loop.
model, epoch, started = Captioner(), 0, time.monotonic()
optimizer = torch.optim.AdamW(model.parameters(), lr=2e-3)
data = RadarText(folder, split="train", batch=32, max_points=48, seed=1)
while time.monotonic() - started < seconds:
    data.set_epoch(epoch := epoch + 1)
    for b in data:
        said = [[0, *(index[word] for word in random.choice(captions).split()), 0] for captions in b["captions"]]
        text = pad_sequence([torch.tensor(s) for s in said], batch_first=True, padding_value=-1)
        out, _ = model.speak(model.word(text[:, :-1].clamp(min=0)), model.hear(b))
        loss = nn.functional.cross_entropy(model.next(out).mT, text[:, 1:], ignore_index=-1)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    print(f"epoch {epoch}, {time.monotonic() - started:.0f} s: loss {loss.item():.2f}", flush=True)

# What it says about motions that it has not seen, and what the most frequent sentence is worth.
with torch.no_grad():
    test = list(RadarText(folder, split="test", max_points=48))
    said = [sentence or "-" for b in test for sentence in model.describe(b)]
references = [captions for b in test for captions in b["captions"]]
usual = Counter(sentences).most_common(1)[0][0]
for name, candidates in (("learned", said), ("most frequent sentence", [usual] * len(said))):
    scores = rl.score(candidates, references)
    print(
        f"{name}: BLEU-4 {scores['bleu_4']:.3f}, CIDEr-D {scores['cider_d']:.2f}, e.g. {candidates[0]!r} for {references[0][0]!r}"
    )
