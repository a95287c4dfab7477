"""Makes captions.json: what the public tools say about the captions of corpus.py.

    pip install pycocoevalcap==1.2 rouge-score==0.1.2 nltk==3.10.4 sacrebleu==2.6.0      # Java 17 on the path
    apt-get download wordnet-base && dpkg-deb -x wordnet-base_*.deb wn
    python captions.py wn/usr/share/wordnet > captions.json

METEOR runs from the jar inside pycocoevalcap, with our function words (its option -s), our abbreviations
(they shadow the jar's on the class path) and a small paraphrase table of our own (its option -a); and once as
pycocoevalcap itself runs it, with all its own lists.
"""

import gzip
import json
import os
import shutil
import subprocess
import sys
import tempfile
from importlib.metadata import version

import nltk
import nltk.translate.meteor_score as nltk_meteor
import pycocoevalcap.meteor
from nltk.corpus.reader.wordnet import WordNetCorpusReader
from nltk.stem.porter import PorterStemmer
from nltk.translate.bleu_score import SmoothingFunction, corpus_bleu, sentence_bleu
from pycocoevalcap.bleu.bleu import Bleu
from pycocoevalcap.cider.cider import Cider
from pycocoevalcap.rouge.rouge import Rouge
from pycocoevalcap.tokenizer.ptbtokenizer import PTBTokenizer
from rouge_score.rouge_scorer import RougeScorer
from sacrebleu.metrics import BLEU
from sacrebleu.tokenizers.tokenizer_13a import Tokenizer13a

from corpus import TEXTS, items, noise

DATA = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "data")
JAR_FOLDER = os.path.dirname(os.path.abspath(pycocoevalcap.meteor.__path__[0] + "/meteor.py"))
# Our own: phrases for each other, both ways, of one to three words.
PARAPHRASES = [("picks up", "lifts"), ("sits down", "takes a seat"), ("walks", "is walking"), ("both arms", "the arms"), ("three times", "again and again"), ("on the floor", "on the ground"), ("fast", "quickly"), ("walks forward", "goes ahead"), ("a box", "the boxes"), ("then", "before he")]


def meteor(items, folder, options, shadow):
    """(corpus value, value of each item, statistics of each item)."""
    class_path = os.pathsep.join(([folder] if shadow else []) + [os.path.join(JAR_FOLDER, "meteor-1.5.jar")])
    command = ["java", "-Xmx2G", "-cp", class_path, "Meteor", "-", "-", "-stdio", "-l", "en", "-norm", *options]
    tool = subprocess.Popen(command, cwd=JAR_FOLDER, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)

    def ask(line):
        tool.stdin.write((line + "\n").encode())
        tool.stdin.flush()

    answers = []
    for candidate, references in items:
        ask(" ||| ".join(["SCORE", *references, candidate]))
        answers.append(tool.stdout.readline().decode().strip())
    ask("EVAL ||| " + " ||| ".join(answers))
    values = [float(tool.stdout.readline()) for _ in items]
    corpus = float(tool.stdout.readline())
    tool.stdin.close()
    tool.wait()
    return {"corpus": corpus, "items": values}


def wordnet_reader(dictionary, folder):
    """nltk's reader over Debian's files, which lack `lexnames`; the names in it do not matter here."""
    for name in os.listdir(dictionary):
        shutil.copy(os.path.join(dictionary, name), folder)
    with open(os.path.join(folder, "lexnames"), "w") as f:
        f.writelines(f"{i:02}\tname{i}\t1\n" for i in range(45))
    nltk.data.path.append(folder)
    # Needs index.sense, which Debian lacks, and only serves other languages.
    WordNetCorpusReader.map_wn = lambda self, version="wordnet": None
    return WordNetCorpusReader(folder, None)


def ptb(texts):
    # The tokenizer looks across line ends; a neutral line between two texts keeps them apart.
    lines = [line for t in texts for line in (t, "x")]
    out = PTBTokenizer().tokenize({i: [{"caption": line}] for i, line in enumerate(lines)})
    return [out[i][0] for i in range(0, len(lines), 2)]


def plain(text):
    import string

    return text.lower().translate(str.maketrans({c: " " for c in string.punctuation})).split()


def nmt_bleu(pairs, smooth):
    """BLEU as in the tensorflow nmt script that HF evaluate ships: shortest reference."""
    import collections
    import math

    out = []
    for max_order in range(1, 5):
        matches, possible = [0] * max_order, [0] * max_order
        reference_length = translation_length = 0
        for candidate, references in pairs:
            reference_length += min(len(r) for r in references)
            translation_length += len(candidate)

            def grams(words):
                return collections.Counter(tuple(words[i : i + n]) for n in range(1, max_order + 1) for i in range(len(words) - n + 1))

            merged = collections.Counter()
            for r in references:
                merged |= grams(r)
            for gram, count in (grams(candidate) & merged).items():
                matches[len(gram) - 1] += count
            for n in range(1, max_order + 1):
                possible[n - 1] += max(0, len(candidate) - n + 1)
        precisions = []
        for n in range(max_order):
            if smooth and n > 0:
                precisions.append((matches[n] + 1.0) / (possible[n] + 1.0))
            else:
                precisions.append(matches[n] / possible[n] if possible[n] > 0 else 0.0)
        mean = math.exp(sum(math.log(p) / max_order for p in precisions)) if min(precisions) > 0 else 0.0
        ratio = translation_length / reference_length if reference_length else 0.0
        penalty = 1.0 if ratio > 1.0 else (math.exp(1 - 1.0 / ratio) if ratio > 0 else 0.0)
        out.append(mean * penalty)
    return out


def main(dictionary):
    corpus = items()
    result = {"versions": {p: version(p) for p in ["pycocoevalcap", "rouge-score", "nltk", "sacrebleu", "numpy"]}}
    java = subprocess.run(["java", "-version"], capture_output=True, text=True).stderr.splitlines()[0]
    result["versions"].update(meteor="1.5 (jar of pycocoevalcap)", ptb="Stanford CoreNLP 3.4.1 (jar of pycocoevalcap)", java=java, wordnet="3.0 (Debian 1:3.0-37)")
    thirteen_a = Tokenizer13a()
    texts = TEXTS + sorted({t for c, r in corpus for t in [c, *r]}) + noise()
    result["tokens"] = [{"text": t, "ptb": p, "13a": thirteen_a(t)} for t, p in zip(texts, ptb([t.replace("\t", " ") for t in texts])) if "\t" not in t]
    stemmed = RougeScorer(["rouge1", "rougeL"], use_stemmer=True)
    raw = [(plain(c), [plain(r) for r in refs]) for c, refs in corpus]
    result["items"] = [{"candidate": c, "references": r} for c, r in corpus]
    rouge = [stemmed.score_multi(refs, c) for c, refs in corpus]
    result["rouge_stemmed"] = [[r["rouge1"].fmeasure, r["rougeL"].fmeasure] for r in rouge]
    weights = [[1.0 / n] * n for n in range(1, 5)]
    smoothing = SmoothingFunction()
    result["bleu"] = {
        "nltk": [corpus_bleu([r for _, r in raw], [c for c, _ in raw], weights=w) for w in weights],
        "nltk_sentences": [[sentence_bleu(r, c, weights=w) for w in weights] for c, r in raw],
        "nltk_sentences_method1": [[sentence_bleu(r, c, weights=w, smoothing_function=smoothing.method1) for w in weights] for c, r in raw],
        "nmt": nmt_bleu(raw, False),
        "nmt_sentences": [nmt_bleu([pair], False) for pair in raw],
        "nmt_smoothed": nmt_bleu(raw, True),
        "sacrebleu": sacre(corpus),
        "coco_sentences": coco_sentences(raw),
    }
    with tempfile.TemporaryDirectory() as folder:
        os.mkdir(os.path.join(folder, "nonbreaking"))
        shutil.copy(os.path.join(DATA, "abbreviations.txt"), os.path.join(folder, "nonbreaking", "english.prefixes"))
        words = os.path.join(folder, "words")
        with open(os.path.join(DATA, "function_words.txt"), encoding="utf-8") as f, open(words, "w", encoding="utf-8") as out:
            out.writelines(w + "\n" for line in f if not line.startswith("# ") for w in line.split())
        table = os.path.join(folder, "table.gz")
        pairs = [line for a, b in PARAPHRASES for line in ("0.5", a, b, "0.5", b, a)]
        with gzip.open(table, "wt", encoding="utf-8") as f:
            f.write("\n".join(pairs) + "\n")
        ours = ["-s", words]
        result["paraphrases"] = pairs
        result["meteor"] = {
            "exact stem": meteor(corpus, folder, [*ours, "-m", "exact stem", "-w", "1.0 0.6"], True),
            "exact stem synonym": meteor(corpus, folder, [*ours, "-m", "exact stem synonym", "-w", "1.0 0.6 0.8"], True),
            "exact stem synonym paraphrase": meteor(corpus, folder, [*ours, "-a", table], True),
            "jar": meteor(corpus, folder, [], False),
        }
        texts_alone = [(t, ["walks.", t]) for t in TEXTS if t.strip() and "\t" not in t]
        result["meteor_texts"] = {"items": texts_alone, **{"exact stem synonym": meteor(texts_alone, folder, [*ours, "-m", "exact stem synonym", "-w", "1.0 0.6 0.8"], True)}}
        dictionary_copy = os.path.join(folder, "wordnet")
        os.mkdir(dictionary_copy)
        reader = wordnet_reader(dictionary, dictionary_copy)
        result["protocols"] = {
            "coco": coco_protocol(corpus, folder, ours),
            "motiongpt": motiongpt_protocol(corpus, reader),
        }
        result["meteor_nltk"] = [nltk_meteor.meteor_score(r, c, wordnet=reader) for c, r in raw]
    porter = PorterStemmer()
    vocabulary = sorted({w for c, r in raw for w in [*c, *(w for t in r for w in t)]})
    result["porter"] = {w: porter.stem(w) for w in vocabulary}
    json.dump(result, sys.stdout, ensure_ascii=True, separators=(",", ":"))
    print()


def sacre(corpus):
    """Per order, over items padded to five references by repetition of the first (which changes nothing)."""
    references = [[(r + [r[0]] * 5)[k] for _, r in corpus] for k in range(5)]
    return [BLEU(max_ngram_order=n).corpus_score([c for c, _ in corpus], references).score / 100 for n in range(1, 5)]


def rouge_means(items):
    scorer = RougeScorer(["rouge1", "rougeL"], use_stemmer=False)
    scores = [scorer.score_multi(r, c) for c, r in items]
    return {f"rouge_{k}": sum(s[name].fmeasure for s in scores) / len(scores) for k, name in [("1", "rouge1"), ("l", "rougeL")]}


def coco_protocol(corpus, folder, ours):
    """pycocoevalcap's own order: PTB tokens, then its scorers; METEOR with our lists. At most 3 references."""
    corpus = [(c, r[:3]) for c, r in corpus]
    tokens = dict(zip(texts := sorted({t for c, r in corpus for t in [c, *r]}), ptb(texts)))
    gts = {i: [tokens[t] for t in r] for i, (_, r) in enumerate(corpus)}
    res = {i: [tokens[c]] for i, (c, _) in enumerate(corpus)}
    bleu, _ = Bleu(4).compute_score(gts, res, verbose=0)
    tokenised = [(res[i][0], gts[i]) for i in gts]
    return {
        **{f"bleu_{k + 1}": float(v) for k, v in enumerate(bleu)},
        **rouge_means(corpus),
        "rouge_l_coco": float(Rouge().compute_score(gts, res)[0]),
        "cider_d": float(Cider().compute_score(gts, res)[0]),
        "meteor": meteor(tokenised, folder, [*ours, "-m", "exact stem synonym", "-w", "1.0 0.6 0.8"], True)["corpus"],
    }


def motiongpt_protocol(corpus, reader):
    """Three references by repetition; nmt's BLEU and nltk's METEOR of bare words, CIDEr of the raw text."""
    corpus = [(c, [r[k % len(r)] for k in range(3)]) for c, r in corpus]
    bare = [(plain(c), [plain(t) for t in r]) for c, r in corpus]
    gts = {i: [t.strip() for t in r] for i, (_, r) in enumerate(corpus)}
    res = {i: [c.strip()] for i, (c, _) in enumerate(corpus)}
    return {
        **{f"bleu_{k + 1}": v for k, v in enumerate(nmt_bleu(bare, False))},
        **rouge_means(corpus),
        "cider_d": float(Cider().compute_score(gts, res)[0]),
        "meteor": sum(nltk_meteor.meteor_score(r, c, wordnet=reader) for c, r in bare) / len(bare),
    }


def coco_sentences(raw):
    gts = {i: [" ".join(t) for t in r] for i, (_, r) in enumerate(raw)}
    res = {i: [" ".join(c)] for i, (c, _) in enumerate(raw)}
    _, sentences = Bleu(4).compute_score(gts, res, verbose=0)
    return [[float(s[i]) for s in sentences] for i in range(len(raw))]


main(sys.argv[1])
