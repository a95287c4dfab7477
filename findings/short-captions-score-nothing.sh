#!/usr/bin/env bash
# A caption that equals its reference scores anything from 0 to 1, if it is short or alone.
#
# Guess: identical sentences have the highest score of every metric.
# What happens: below four words BLEU-4 is 3e-5 to 0.03 in the COCO evaluation, 1e-231 to 1e-77 in nltk, 0 in
# sacrebleu's corpus score and 100 (of 100) in its sentence score. CIDEr is 0 for one item, whatever it says, because the document
# frequencies come from the references: all n-grams of the only item are in every document.
# Why it matters: motion captions are short ("a person falls"), and papers print these numbers side by side.
# What to do: compare only corpora, name the rules, and never report CIDEr of a single clip. Here: rules have names
# (docs/reference/metrics.md, "Protocols"), and COCO's values are reproduced to 1e-9, the small ones too.
source "$(dirname "$0")/lib.sh"
install numpy==2.4.6 pycocoevalcap==1.2 nltk==3.10.4 sacrebleu==2.6.0
observe <<'PYTHON'
import contextlib
import io

import sacrebleu
from nltk.translate.bleu_score import sentence_bleu
from pycocoevalcap.bleu.bleu import Bleu
from pycocoevalcap.cider.cider import Cider

from finding import report


def coco(scorer, captions):
    pairs = {i: [caption] for i, caption in enumerate(captions)}
    with contextlib.redirect_stdout(io.StringIO()):
        return scorer.compute_score(pairs, pairs)[0]


observed = []
for caption in ("falls", "a person falls", "a person falls down"):
    observed.append(
        f"{caption!r} against itself: BLEU-4 {coco(Bleu(4), [caption])[3]:.5f} (COCO), "
        f"{sentence_bleu([caption.split()], caption.split()):.0e} (nltk), "
        f"{sacrebleu.sentence_bleu(caption, [caption]).score:.0f} (sacrebleu, sentence), "
        f"{sacrebleu.corpus_bleu([caption], [[caption]]).score:.0f} (sacrebleu, corpus)"
    )
longer = "a person walks slowly to the left and then sits down"
observed.append(f"CIDEr of one long caption against itself: {coco(Cider(), [longer]):.2f}")
observed.append(
    f"CIDEr of two different captions against themselves: {coco(Cider(), [longer, 'someone waves the right hand twice']):.2f}"
)
report(
    "the highest score, in the unit of each program (1, 10 or 100)",
    observed,
    [
        "'falls' against itself: BLEU-4 0.00003 (COCO), 2e-231 (nltk), 100 (sacrebleu, sentence), 0 (sacrebleu, corpus)",
        "'a person falls' against itself: BLEU-4 0.03162 (COCO), 1e-77 (nltk), 100 (sacrebleu, sentence), 0 (sacrebleu, corpus)",
        "'a person falls down' against itself: BLEU-4 1.00000 (COCO), 1e+00 (nltk), 100 (sacrebleu, sentence), 100 (sacrebleu, corpus)",
        "CIDEr of one long caption against itself: 0.00",
        "CIDEr of two different captions against themselves: 10.00",
    ],
)
PYTHON
