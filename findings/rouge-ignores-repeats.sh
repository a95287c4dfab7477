#!/usr/bin/env bash
# The package `rouge` scores three claps like one.
#
# Guess: `rouge` and `rouge-score` compute the same ROUGE-1 and ROUGE-L, up to rounding.
# What happens: `rouge` compares sets of n-grams by default (`exclusive=True`), for ROUGE-L too, so repeated words
# count once: "claps claps claps" against "claps" has F1 1.0, where `rouge-score` and the COCO evaluation have about
# a half. `exclusive=False` counts them.
# Why it matters: counts and orders of repeated words ("steps left and steps left") are what a radar caption is
# about, and both packages are cited as ROUGE.
# What to do: use `rouge-score`. Here: `rouge_1` and `rouge_l` are those of rouge-score (docs/reference/metrics.md).
source "$(dirname "$0")/lib.sh"
install numpy==2.4.6 rouge==1.0.1 rouge-score==0.1.2 pycocoevalcap==1.2
observe <<'PYTHON'
from pycocoevalcap.rouge.rouge import Rouge as CocoRouge
from rouge import Rouge
from rouge_score.rouge_scorer import RougeScorer

from finding import report

observed = []
for caption, reference in (
    ("claps claps claps", "claps"),
    ("a person steps left and steps left and steps right", "a person steps left and steps right"),
):
    sets = Rouge().get_scores(caption, reference)[0]
    counts = Rouge(exclusive=False).get_scores(caption, reference)[0]
    score = RougeScorer(["rouge1", "rougeL"]).score(reference, caption)
    coco = CocoRouge().calc_score([caption], [reference])
    observed.append(
        f"{caption!r} against {reference!r}: ROUGE-1 {sets['rouge-1']['f']:.2f} (rouge), "
        f"{counts['rouge-1']['f']:.2f} (rouge, exclusive=False), {score['rouge1'].fmeasure:.2f} (rouge-score); "
        f"ROUGE-L {sets['rouge-l']['f']:.2f} (rouge), {score['rougeL'].fmeasure:.2f} (rouge-score), {coco:.2f} (COCO)"
    )
report(
    "the same F1 in rouge and rouge-score, below 1",
    observed,
    [
        "'claps claps claps' against 'claps': ROUGE-1 1.00 (rouge), 0.50 (rouge, exclusive=False), 0.50 (rouge-score); "
        "ROUGE-L 1.00 (rouge), 0.50 (rouge-score), 0.55 (COCO)",
        "'a person steps left and steps left and steps right' against 'a person steps left and steps right': "
        "ROUGE-1 1.00 (rouge), 0.82 (rouge, exclusive=False), 0.82 (rouge-score); "
        "ROUGE-L 1.00 (rouge), 0.82 (rouge-score), 0.85 (COCO)",
    ],
)
PYTHON
