"""Makes wordnet.txt, the synonym table of METEOR: single words of WordNet 3.0, grouped by synset.

    apt-get download wordnet-base && dpkg-deb -x wordnet-base_*.deb wn        # WordNet 3.0, Debian 1:3.0-37
    unzip meteor-1.5.jar synonym/english.synsets                              # WordNet data, see below
    python3 wordnet_table.py wn/usr/share/wordnet synonym/english.synsets > wordnet.txt

Multi-word entries are left out, because both METEORs compare single words. A synset of one word only
stands in the table if that word would otherwise be missing from its part of speech.

METEOR's jar numbers synsets by their byte offset in Princeton's four data files without the part of
speech, so that a few hundred pairs of unrelated synsets share a number and their words count as
synonyms. These offsets are the only thing taken from the jar's english.synsets (a WordNet file under the WordNet
licence, says its COPYING.WORDNET; Debian's own offsets are shifted by an edit). Section `shared` lists
those pairs.
"""

import re
import sys
from collections import defaultdict

NOTICE = open(__file__.replace("wordnet_table.py", "LICENSE.wordnet"), encoding="ascii").read()
dictionary, jar_synsets = sys.argv[1:3]
out = sys.stdout
out.write("".join(f"# {line}".rstrip() + "\n" for line in NOTICE.splitlines()))
single_words = set()
offsets = defaultdict(set)
lines = open(jar_synsets, encoding="utf-8").read().splitlines()
for word, numbers in zip(lines[::2], lines[1::2]):
    if "_" not in word:
        for number in numbers.split():
            offsets[number].add(word.strip())
synsets = []
for part in ["noun", "verb", "adj", "adv"]:
    groups, singles, seen = [], [], set()
    for line in open(f"{dictionary}/data.{part}", encoding="ascii"):
        if line.startswith(" "):
            continue
        fields = line.split()
        n_words = int(fields[3], 16)
        words = [re.sub(r"\((a|p|ip)\)$", "", w) for w in fields[4 : 4 + 2 * n_words : 2]]
        words = [w for w in dict.fromkeys(words) if "_" not in w]
        if words:
            synsets.append({w.lower() for w in words})
        if len(words) > 1:
            groups.append(words)
            seen.update(words)
        elif words:
            singles.append(words[0])
    out.write(f"[{part}]\n")
    for words in groups:
        out.write(" ".join(words) + "\n")
    for word in dict.fromkeys(singles):
        if word not in seen:
            out.write(word + "\n")
known = {frozenset(s) for s in synsets}
out.write("[shared]\n")
for number in sorted(offsets):
    if frozenset(offsets[number]) not in known:
        out.write(" ".join(sorted(offsets[number])) + "\n")
for part in ["noun", "verb", "adj", "adv"]:
    out.write(f"[{part} exceptions]\n")
    for line in open(f"{dictionary}/{part}.exc", encoding="ascii"):
        if "_" not in line:
            out.write(" ".join(line.split()) + "\n")
