"""Makes embeddings.json: bert_score's own functions on random matrices.

    pip install bert_score==0.3.13 torch        # any version of transformers that it imports
    python embeddings.py > embeddings.json
"""

import json
import random
import sys
from importlib.metadata import version

import torch
from bert_score import utils

DIMENSION = 6
torch.manual_seed(3)
rng = random.Random(3)


def sentence(n):
    values = torch.randn(n, DIMENSION).float()
    weights = [0.0] + [rng.choice([0.0, 0.5, 1.0, rng.random()]) for _ in range(n - 2)] + [0.0]
    if n > 2:
        weights[1] = max(weights[1], 0.25)
    return values, weights


pairs = []
for lengths in [(3, 3), (4, 6), (7, 3), (2, 5), (5, 2), (2, 2), (8, 8), (12, 9), (3, 11)]:
    (c, cw), (r, rw) = sentence(lengths[0]), sentence(lengths[1])

    def batch(values, weights):
        return values.double().clone()[None], torch.ones(1, len(weights)), torch.tensor([weights], dtype=torch.double)

    # bert_score gives not-a-number for weights that sum to 0; only sentences without words have such here.
    p, r_, f = utils.greedy_cos_idf(*batch(r, rw), *batch(c, cw))
    pairs.append({"candidate": c.flatten().tolist(), "candidate_weights": cw, "reference": r.flatten().tolist(), "reference_weights": rw, "score": [float(p), float(r_), float(f)]})

# The same pairs as bert_score compares them: 70 in batches of 64, padded.
stats = {f"{side}{i}": (torch.tensor(p[side]).double().reshape(-1, DIMENSION), torch.tensor(p[side + "_weights"], dtype=torch.double)) for i, p in enumerate(pairs) for side in ("candidate", "reference")}
utils.get_bert_embedding = lambda batch, *_, **__: padded(batch)


def padded(names):
    lengths = [len(stats[n][1]) for n in names]
    pad = torch.nn.utils.rnn.pad_sequence
    embeddings = pad([stats[n][0] for n in names], batch_first=True)
    masks = torch.tensor([[int(k < n) for k in range(max(lengths))] for n in lengths])
    return embeddings, masks, pad([stats[n][1] for n in names], batch_first=True)


names = [i % len(pairs) for i in range(70)]
p_r_f = utils.bert_cos_score_idf(torch.nn.Linear(1, 1), [f"reference{i}" for i in names], [f"candidate{i}" for i in names], None, None, device="cpu")
batches = p_r_f.double().tolist()

utils.sent_encode = lambda tokenizer, ids: ids
documents = [[0, 5, 6, 6, 2], [0, 5, 2], [0, 7, 8, 5, 2], [0, 5, 2], [0, 2]]
idf = utils.get_idf_dict(documents, None, nthreads=0)
vectors = [torch.randn(DIMENSION).float() for _ in range(6)]
cosines = [float(torch.nn.functional.cosine_similarity(a.double(), b.double(), dim=0)) for a, b in zip(vectors, vectors[1:])]
json.dump(
    {
        "versions": {p: version(p) for p in ["bert_score", "torch", "transformers"]},
        "dimension": DIMENSION,
        "pairs": pairs,
        "batches": batches,
        "documents": documents,
        "idf": {str(i): idf[i] for i in [0, 2, 5, 6, 7, 99]},
        "vectors": [v.tolist() for v in vectors],
        "cosines": cosines,
    },
    sys.stdout,
    separators=(",", ":"),
)
print()
