"""Makes goldens.json: what the Python packages say about our own sentences.

Run with Python 3.11+ in an environment with

    pip install pycocoevalcap==1.2 rouge-score==0.1.2 nltk

    python generate.py > goldens.json

The scorers get text that is already normalised, so Java's PTB tokenizer is not needed. Plain CIDEr
exists in no package; it is the same scorer with its similarity replaced by the cosine.
"""

import json
import string
import sys
from importlib.metadata import version

import numpy as np
from nltk.translate.bleu_score import SmoothingFunction, sentence_bleu
from pycocoevalcap.bleu.bleu import Bleu
from pycocoevalcap.cider.cider_scorer import CiderScorer
from pycocoevalcap.rouge.rouge import Rouge
from rouge_score.rouge_scorer import RougeScorer

# (candidate, references). Own wording; the comment says what an item is there for.
ITEMS = [
    ("A person walks forward slowly.", ["A person walks slowly forward.", "Someone strolls ahead.", "the man walks forward"]),
    ("a person walks forward", ["a person walks forward"]),  # identical, one reference
    ("", ["a person stands still", "someone does not move"]),  # empty candidate
    ("   ", ["the figure waits"]),  # blank candidate
    ("falls", ["a person falls", "falls", "someone falls down hard"]),  # one word
    ("jumps", ["a woman sits down on a chair"]),  # one word, no match
    ("the the the the", ["the person turns to the left and the right", "a person turns"]),  # clipping
    ("a person waves the left hand", ["a person waves a hand with the left arm", "the left hand waves", "waving left", "a person waves the left hand twice", "person waves"]),  # five references
    ("a man sits down", ["a man sits", "a man sits down again"]),  # length tie: 3 and 5 words against 4
    ("a man sits down", ["a man sits down again", "a man sits"]),  # the same, other order
    ("someone picks up a box from the floor and puts it on the table", ["a person lifts a box off the floor", "the person picks a box up from the floor and sets it on a table"]),
    ("He kicks with his RIGHT leg!", ["he kicks with his right leg.", "a kick of the right leg"]),  # case, punctuation
    ("half-turn, then stop", ["a half turn, then a stop", "turns half way; then stops"]),  # hyphen
    ("the person's arms are raised", ["the persons arms are raised", "the person raises both arms"]),  # apostrophe
    ("walks 2.5 m at 1,000 mm/s", ["walks 2.5 m", "moves 2.5 metres at 1,000 mm per second"]),  # numbers
    ("a d\u00e9tendu stretch of the arms", ["a d\u00e9tendu stretch of both arms", "na\u00efve stretching"]),  # non-ASCII letters
    ("clap clap clap", ["clap clap", "clap clap clap clap"]),  # tie with repeats
    ("a person crouches  and   stands up", ["a person crouches and stands up", "a person  crouches"]),  # runs of spaces
    ("walk", ["walk"]),  # one word, exact
    ("a person walks in a circle and then walks in a circle again", ["a person walks in a circle twice", "two circles are walked"]),
    ("someone lies on the floor without moving", ["a person lies on the ground", "someone is lying motionless on the floor", "the body rests on the floor"]),
    ("a person runs quickly to the right and stops", ["a person runs right then stops", "a person runs to the right quickly and then stops suddenly"]),
    ("the person does jumping jacks", ["a person is doing jumping jacks", "the person does several jumping jacks in place", "jumping jacks", "someone jumps with arms and legs apart"]),
    ("!!!", ["stop!", "halt"]),  # punctuation only
    ("a person stands up from a chair, walks forward and sits down on the floor", ["a person gets up from a chair and walks forward before sitting on the floor"]),
    ("a person walks forward", ["a person walks backward", "a person walks to the back"]),  # near miss
    ("turns left", ["turns left turns left", "left turns"]),
]


def plain(text):
    table = str.maketrans({c: " " for c in string.punctuation})
    return " ".join(text.lower().translate(table).split())


def raw(text):
    return text.strip()


class PlainCider(CiderScorer):
    """Cosine of TF-IDF vectors: neither clipping nor length penalty."""

    def scores(self):
        self.compute_doc_freq()
        log_n = np.log(float(len(self.crefs)))

        def vector(counts, n):
            return {g: tf * (log_n - np.log(max(1.0, self.document_frequency.get(g, 0.0)))) for g, tf in counts.items() if len(g) == n}

        out = []
        for test, refs in zip(self.ctest, self.crefs):
            total = 0.0
            for ref in refs:
                for n in range(1, self.n + 1):
                    a, b = vector(test, n), vector(ref, n)
                    dot = sum(v * b.get(g, 0.0) for g, v in a.items())
                    norm = np.sqrt(sum(v * v for v in a.values())) * np.sqrt(sum(v * v for v in b.values()))
                    total += dot / norm if norm != 0 else 0.0
            out.append(10.0 * total / self.n / len(refs))
        return out


def corpus(indices, normalise, max_references):
    items = [(ITEMS[i][0], ITEMS[i][1][: max_references or None]) for i in indices]
    gts = {i: [normalise(r) for r in refs] for i, (_, refs) in enumerate(items)}
    res = {i: [normalise(c)] for i, (c, _) in enumerate(items)}
    bleu, _ = Bleu(4).compute_score(gts, res, verbose=0)
    coco_l, _ = Rouge().compute_score(gts, res)
    cider_d, cider = CiderScorer(), PlainCider()
    for i in gts:
        cider_d += (res[i][0], gts[i])
        cider += (res[i][0], gts[i])
    scorer = RougeScorer(["rouge1", "rougeL"], use_stemmer=False)
    rouge = [scorer.score_multi(refs, c) for c, refs in items]
    tokens = [res[i][0].split() for i in res]
    self_bleu = [
        sentence_bleu(tokens[:i] + tokens[i + 1 :], t, smoothing_function=SmoothingFunction().method1)
        for i, t in enumerate(tokens)
    ] if len(tokens) > 1 else [float("nan")]
    values = {f"bleu_{k + 1}": v for k, v in enumerate(bleu)}
    values["rouge_1"] = float(np.mean([r["rouge1"].fmeasure for r in rouge]))
    values["rouge_l"] = float(np.mean([r["rougeL"].fmeasure for r in rouge]))
    values["rouge_l_coco"] = float(coco_l)
    values["cider_d"] = float(cider_d.compute_score()[0])
    values["cider"] = float(np.mean(cider.scores()))
    values["self_bleu"] = None if len(tokens) < 2 else float(np.mean(self_bleu))
    return values


n = len(ITEMS)
# The whole, every item alone, and the whole without every item: errors cannot hide in a mean.
SUBSETS = [list(range(n))] + [[i] for i in range(n)] + [[j for j in range(n) if j != i] for i in range(n)]
json.dump(
    {
        "versions": {p: version(p) for p in ["pycocoevalcap", "rouge-score", "nltk", "numpy"]},
        "items": [{"candidate": c, "references": r} for c, r in ITEMS],
        "cases": [
            {"protocol": name, "max_references": m, "indices": s, "values": corpus(s, rule, m)}
            for name, rule in [("plain", plain), ("nlg-eval", raw)]
            for m in [3, 0]
            for s in SUBSETS
        ],
    },
    sys.stdout,
    ensure_ascii=True,
    separators=(",", ":"),
)
print()
