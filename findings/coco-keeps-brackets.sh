#!/usr/bin/env bash
# The COCO evaluation drops punctuation, but turns brackets into words.
#
# Guess: its tokenizer removes brackets as it removes commas; the list of what it drops contains -LRB- and -RRB-.
# What happens: the Java program writes lower case (-lrb-), and the list has upper case, so brackets stay as two more
# words in captions and references, in BLEU, METEOR, ROUGE-L and CIDEr alike. "cannot" and "gonna" become two words.
# Why it matters: people and language models write "(slowly)" or "(left hand)" in captions of motions. A caption of
# four right words loses two of six unigrams.
# What to do: remove brackets before scoring and say so. Here: protocol `coco` keeps the words, as the original does;
# protocol `plain` drops them (crates/metrics/src/ptb.rs).
source "$(dirname "$0")/lib.sh"
need java
install numpy==2.4.6 pycocoevalcap==1.2
observe <<'PYTHON'
import contextlib
import io
import os

from pycocoevalcap.bleu.bleu import Bleu
from pycocoevalcap.tokenizer.ptbtokenizer import PTBTokenizer

from finding import report


def tokens(*captions):
    # The Java program prints its speed to standard error.
    saved, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        return PTBTokenizer().tokenize({i: [{"caption": caption}] for i, caption in enumerate(captions)})
    finally:
        os.dup2(saved, 2)


captions = ["A person walks (slowly).", "A person walks, slowly!", "He cannot stand; gonna sit [left]."]
out = tokens(*captions)
observed = [f"{caption!r} -> {out[i][0]!r}" for i, caption in enumerate(captions)]
with contextlib.redirect_stdout(io.StringIO()):
    bleu = Bleu(4).compute_score({0: out[1]}, {0: out[0]})[0]
observed.append(f"the first against the second: BLEU-1 {bleu[0]:.2f}")
report(
    "'a person walks slowly' twice, BLEU-1 1.00",
    observed,
    [
        "'A person walks (slowly).' -> 'a person walks -lrb- slowly -rrb-'",
        "'A person walks, slowly!' -> 'a person walks slowly'",
        "'He cannot stand; gonna sit [left].' -> 'he can not stand gon na sit -lsb- left -rsb-'",
        "the first against the second: BLEU-1 0.67",
    ],
)
PYTHON
