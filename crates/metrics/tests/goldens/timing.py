"""Times `score` and the Python packages on the same captions in the same run.

    cargo bench --no-run -p radarllm-metrics --bench score_speed    # prints PROGRAM
    python timing.py 100000 PROGRAM FOLDER [--no-packages]

Writes c.jsonl and r.jsonl into FOLDER. The packages are those of captions.py: pycocoevalcap with its Java
tokenizer and METEOR (4 matchers, its own data), rouge-score. Self-BLEU and intervals have no counterpart there.
"""

import gc
import json
import os
import resource
import subprocess
import sys
import time

from corpus import items

n, program, folder = int(sys.argv[1]), sys.argv[2], sys.argv[3]
os.makedirs(folder, exist_ok=True)
corpus = [(c, (r + r[:1] * 3)[:3]) for c, r in items(seed=1, n=n)][:n]
with open(f"{folder}/c.jsonl", "w") as c, open(f"{folder}/r.jsonl", "w") as r:
    for i, (candidate, references) in enumerate(corpus):
        c.write(json.dumps({"id": str(i), "text": candidate}) + "\n")
        r.write(json.dumps({"id": str(i), "texts": references}) + "\n")


def cpu_s():
    """Processor time of this process and its finished children: wall time says little on a busy machine."""
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in usage)


for protocol in ["plain", "coco"]:
    start = cpu_s()
    subprocess.run([program, f"{folder}/c.jsonl", f"{folder}/r.jsonl", protocol], check=True)
    print(f"{protocol}, reading included: {cpu_s() - start:.1f} s of processor time", flush=True)
if "--no-packages" in sys.argv:
    sys.exit()

from pycocoevalcap.bleu.bleu import Bleu
from pycocoevalcap.cider.cider import Cider
from pycocoevalcap.meteor.meteor import Meteor
from pycocoevalcap.rouge.rouge import Rouge
from pycocoevalcap.tokenizer.ptbtokenizer import PTBTokenizer
from rouge_score.rouge_scorer import RougeScorer

total = 0.0


def timed(name, work):
    global total
    wall, cpu = time.perf_counter(), cpu_s()
    value = work()
    gc.collect()
    wall, cpu = time.perf_counter() - wall, cpu_s() - cpu
    total += cpu
    print(f"{name}: {wall:.1f} s, {cpu:.1f} s of processor time", flush=True)
    return value


texts = {i: [{"caption": c}] + [{"caption": t} for t in r] for i, (c, r) in enumerate(corpus)}
tokens = timed("Stanford PTB (Java)", lambda: PTBTokenizer().tokenize(texts))
res = {i: t[:1] for i, t in tokens.items()}
gts = {i: t[1:] for i, t in tokens.items()}
timed("BLEU", lambda: Bleu(4).compute_score(gts, res, verbose=0))
timed("ROUGE-L (coco)", lambda: Rouge().compute_score(gts, res))
timed("CIDEr-D", lambda: Cider().compute_score(gts, res))
scorer = RougeScorer(["rouge1", "rougeL"], use_stemmer=False)
timed("rouge-score", lambda: [scorer.score_multi(r, c) for c, r in corpus])
timed("METEOR (Java)", lambda: Meteor().compute_score(gts, res))
print(f"packages together: {total:.1f} s of processor time")
