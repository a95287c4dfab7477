#!/usr/bin/env bash
# nltk's METEOR and METEOR 1.5 are two metrics with one name.
#
# Guess: both give nearly the same value, up to synonyms.
# What happens: nltk has the parameters of 2005, where order hardly counts; the COCO evaluation runs METEOR 1.5, tuned
# on human rankings. A caption with left and right exchanged has 0.97 in one and 0.50 in the other. An identical
# sentence of one word has 0.5 in nltk, and three words have 0.98, because a single chunk is still punished.
# Why it matters: motion papers print either one as "METEOR"; their values can't be compared, and nltk's hardly
# punishes exchanged sides.
# What to do: name the implementation. Here: protocol `motiongpt` has nltk's, the others 1.5 (docs/reference/metrics.md), and
# confused sides are counted by `facts.contradictions`.
source "$(dirname "$0")/lib.sh"
need java
install numpy==2.4.6 pycocoevalcap==1.2 nltk==3.10.4
observe <<'PYTHON'
from nltk.translate.meteor_score import meteor_score
from pycocoevalcap.meteor.meteor import Meteor

from finding import report


class NoSynonyms:
    """Stands in for WordNet, whose data nltk would download. All words below match exactly."""

    def synsets(self, *_):
        return []


pairs = [
    ("a person turns to the left then to the right", "a person turns to the right then to the left"),
    ("a person falls", "a person falls"),
    ("falls", "falls"),
]
jar = Meteor().compute_score({i: [r] for i, (_, r) in enumerate(pairs)}, {i: [c] for i, (c, _) in enumerate(pairs)})[1]
observed = [
    f"{c!r} against {r!r}: {meteor_score([r.split()], c.split(), wordnet=NoSynonyms()):.2f} (nltk), {score:.2f} (1.5)"
    for (c, r), score in zip(pairs, jar)
]
report(
    "about the same value, clearly below 1 for exchanged sides, 1 for identical sentences",
    observed,
    [
        "'a person turns to the left then to the right' against 'a person turns to the right then to the left': 0.97 (nltk), 0.50 (1.5)",
        "'a person falls' against 'a person falls': 0.98 (nltk), 1.00 (1.5)",
        "'falls' against 'falls': 0.50 (nltk), 1.00 (1.5)",
    ],
)
PYTHON
