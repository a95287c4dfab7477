"""Our own captions for the goldens: 260 candidates with one to five references each.

The first items are written by hand, each for a rule that is easy to get wrong; the rest are put together
from phrases by a fixed seed, with synonyms, inflected forms, repetitions and changes of order.
"""

import random

# Texts for the tokenisers and normalisers: punctuation, numbers, quotes, brackets, abbreviations, Unicode.
TEXTS = [
    "", " ", "\t", "walks", "...", "!", "a", "I", "I.", "A.", "-", "--", "'", '"', "`", "\u2019",
    "A person walks forward.", "a person walks forward , then stops .", "The man's arm; the men's arms: Tom's",
    "He doesn't move, can't stand, won't sit & isn't lying", "cannot stop", "Cannot", "gonna walk, wanna sit, gotta run",
    "it's 2.5 m away", "I'm, you're, we've, they'll, he'd", "y'all won't", "rock 'n' roll", "'tis raised", "'twas low",
    "walks 10kg 1,000 m at 2.5 m/s until 5:30 p.m. or so", "at 5:30 p.m.", "5 p.m. Then stops", "from 10 a.m. to 3 p.m.",
    "walks/runs and/or jumps", "1/2 turn", "a 3/4 turn", "1 1/2 turns", "\u00bd a turn", "half-turn", "a well-known, left-to-right step", "left- and right-handed",
    "100% sure", "50 % slower", "$5 and #3", "a+b=c", "x^2 ~ 4 < 5 > 3", "a*b ** c", "\\ / \\/", "C:\\x", "@home #fit", "me@home.org", "www.radar.org/x", "http://radar.org/a?b=1", "radar.com",
    "(walks)", "walks (slowly) left", "[walks] {left} <right>", "((a))", "a (b", "<b>bold</b> move", "&amp; &lt; &gt; &quot;x&quot; &nbsp;y", "&",
    '"walks" he said', "'walks' he said", "\u201cwalks\u201d and \u2018sits\u2019", "the person\u2019s arm doesn\u2019t move", "``walks'' `sits'", "\u00abwalks\u00bb \u2039x\u203a", "a ''b'' c", '5\'10" tall', "6' 2\"", "the '90s", "1990s",
    "walks... then stops", "walks.. stops", "walks .... stops", "walks . . . stops", "walks\u2026 stops", "stop!!! now?!", "what??", "walks,stops", "walks.Stops", "walks.stops", "walks;stops:turns", "walks , , stops", ",,,", "1,2,3", "1, 2, 3", "a,1 b,2", "1,a", ".5 m", "-5 m +3", "3-5 steps", "3 - 5", "2x4", "3D 2d", "1st 2nd 3rd", "v2.0", "10:15:30", "12/05/2020", "1-2-2020", "+49 123 4567", "555-1234", "(555) 123-4567",
    "walks \u2013 then \u2014 stops", "walks\u2014stops", "walks - stops -- turns --- sits ---- end", "a_b __init__ x_", "well -known", "-left", "left-", "--left",
    "caf\u00e9 d\u00e9tendu na\u00efve", "\u00dcber \u00c5ngstr\u00f6m \u00df", "\u4eba\u5728\u8d70\u8def", "\u0447\u0435\u043b\u043e\u0432\u0435\u043a \u0438\u0434\u0451\u0442", "\u05d0\u05d1 \u0645\u0631\u062d\u0628\u0627", "\U0001f3c3 runs \U0001f600", "a\u00a0b\u2009c\u3000d", "soft\u00adhyphen", "\ufb01ve", "\u00b0C 5\u00b0", "\u20ac5 \u00a35 \u00a55", "x\u00b2 H\u2082O", "\u2022 walks", "a\u200bb", "e\u0301", "\u2122 \u00ae \u00a9",
    "Mr. Smith walks", "Dr. No sits. Mrs. X stands.", "St. John", "Prof. Lee, Ph.D. and M.D.", "U.S. army", "in the U.S. The man", "e.g. walking, i.e. moving", "vs. the wall", "No. 5 turns", "no. never", "Fig. 3", "approx. 3 m", "etc.", "etc. and so on", "Jan. 5", "Inc. and Co. Ltd.", "J. R. R. walks", "the a. b. c.", "walks. then sits.", "walks. Then sits.", "ca. 5 min. left", "sec. 3", "ft. 5", "O'Neil's arm", "d'Artagnan l'arm", "ma'am o'clock", "students' arms", "James' arm", "ol' man", "an' then", "somethin' odd", "the dog's", "'s", "n't", "don't", "DON'T STOP", "It'S", "HE'S", "A.B.C", "a.b", "x.y.z.", "WALKS LEFT",
    "colour grey centre metre analyse towards travelling", "favourite theatre", "a  b   c", " leading and trailing ", "a b\tc", "x" * 60, "a-" * 20, "walk " * 40,
]

# (candidate, references): rules of matching, lengths and ties.
WRITTEN = [
    ("A person walks forward slowly.", ["A person walks slowly forward.", "Someone strolls ahead.", "the man walks forward"]),
    ("a person walks forward", ["a person walks forward"]),
    ("", ["a person stands still", "someone does not move"]),
    ("   ", ["the figure waits"]),
    ("...", ["a person stands", "!"]),
    ("falls", ["a person falls", "falls", "someone falls down hard"]),
    ("falls", ["falls"]),
    ("jumps", ["a woman sits down on a chair"]),
    ("the the the the", ["the person turns to the left and the right", "a person turns"]),
    ("a person waves the left hand", ["a person waves a hand with the left arm", "the left hand waves", "waving left", "a person waves the left hand twice", "person waves"]),
    ("a man sits down", ["a man sits", "a man sits down again"]),
    ("a man sits down", ["a man sits down again", "a man sits"]),
    ("He kicks with his RIGHT leg!", ["he kicks with his right leg.", "a kick of the right leg"]),
    ("half-turn, then stop", ["a half turn, then a stop", "turns half way; then stops"]),
    ("the person's arms aren't raised", ["the persons arms are raised", "the person doesn't raise both arms"]),
    ("walks 2.5 m at 1,000 mm/s", ["walks 2.5 m", "moves 2.5 metres at 1,000 mm per second"]),
    ("a d\u00e9tendu stretch of the arms", ["a d\u00e9tendu stretch of both arms", "na\u00efve stretching"]),
    ("clap clap clap", ["clap clap", "clap clap clap clap"]),
    ("walk", ["walking"]),
    ("left right left right left right", ["right left right left", "left left right right", "right"]),
    ("a a a a a b b b b", ["b a b a b a b a b", "a b a b a b"]),
    ("\U0001f3c3", ["runs", "\u4eba\u5728\u8d70\u8def"]),
    ("the quick man ran and the big man jumped", ["the fast man was running and the large man leaped", "a large man leaps"]),
    ("children feet men geese", ["child foot man goose", "kids"]),
    ("he begins to stride", ["he starts to walk", "he commences a stride", "start"]),
    ("aid habit bear", ["marketing now record", "help use wear"]),
    ("an offer is awayed", ["an off is away", "away"]),
    ("hopeful useful handfuls", ["hope use handful"]),
    ("she picks up the box . she puts it down .", ["she lifts the box and sets it down", "she picks the box up, then she puts it down"]),
    ("(slowly) walks \"left\"", ["slowly walks left", "walks -lrb- slowly -rrb- left"]),
    ("walks " * 30, ["walks " * 25, "walk " * 30]),
    ("a person walks in a circle and then walks in a circle again and then walks in a circle once more before the person sits down", ["in a circle a person walks again and again and then the person sits down before the person walks once more in a circle", "a person walks in circles"]),
]

SUBJECTS = ["a person", "A person", "the person", "someone", "the man", "a woman", "The figure", "he", "she", "a child"]
VERBS = [["walks", "strolls", "is walking", "walked", "moves", "goes"], ["runs", "is running", "ran", "sprints", "jogs"], ["jumps", "leaps", "is jumping", "jumped", "hops", "springs"], ["sits down", "takes a seat", "is sitting", "sat"], ["falls", "collapses", "tumbles", "is falling", "fell down"], ["waves", "is waving", "gestures", "waved"], ["turns", "rotates", "spins", "is turning", "twisted"], ["picks up a box", "lifts a box", "raises the boxes", "is lifting a carton"], ["kicks", "is kicking", "kicked a ball", "boots the ball"], ["crouches", "squats", "stoops", "is squatting", "bends down"], ["lies on the floor", "is lying on the ground", "rests on the floor", "lay down"], ["stretches both arms", "extends the arms", "is stretching", "raises both hands"]]
MANNERS = ["", "slowly", "quickly", "fast", "rapidly", "carefully", "with the left hand", "with his right leg", "to the left", "to the right", "forward", "forwards", "ahead", "backward", "in a circle", "2.5 m", "3 times", "three times", "again and again", "at 1,000 mm/s", "on one leg", "near the wall"]
JOINS = [" and ", ", then ", " and then ", "; ", " before he ", ". Then ", " while ", ", "]
ENDS = ["", "", ".", " .", "!", "..."]


def sentence(rng, verbs):
    parts = []
    for group in verbs:
        manner = rng.choice(MANNERS)
        parts.append((rng.choice(VERBS[group]) + " " + manner).strip())
    text = rng.choice(SUBJECTS) + " " + parts[0]
    for part in parts[1:]:
        text += rng.choice(JOINS) + part
    return text + rng.choice(ENDS)


def items(seed=7, n=230):
    rng = random.Random(seed)
    out = list(WRITTEN)
    for _ in range(n):
        verbs = [rng.randrange(len(VERBS)) for _ in range(rng.choice([1, 1, 2, 2, 3, 5]))]
        references = [sentence(rng, verbs if rng.random() < 0.8 else verbs[::-1]) for _ in range(rng.randint(1, 5))]
        kind = rng.random()
        if kind < 0.15:
            candidate = rng.choice(references)
        elif kind < 0.3:
            words = rng.choice(references).split()
            rng.shuffle(words)
            candidate = " ".join(words)
        elif kind < 0.4:
            candidate = sentence(rng, [rng.randrange(len(VERBS))])
        else:
            candidate = sentence(rng, verbs)
        out.append((candidate, references))
    return out


NOISE_WORDS = "a person walks forward the man's doesn't can't left half-turn slowly U.S. p.m. e.g. 2.5 1,000 10kg 5:30 m/s it's they'll I'm Mr. Dr. no. 5 100% 3 O'Neil cannot gonna etc. walks, stops. (left) \"up\" 'down' turns; runs: stop! now? ... then -- and/or - A.B. x-y 'em rock'n'roll students' \u2019s \u201cquoted\u201d caf\u00e9 \u2014 3D 1st 90's '90s 1/2 5ft $5 #1 a+b A&B [x] {y} <z> * / \\ & = + _ @x x@y.z www.a.b :) etc".split()
NOISE_CHARACTERS = "aabbeentTNsSdDmrvlo''\u2019.,;:-!?()\"/ 0 1 2 5 &_$#@*`"


def noise(seed=5, n=200):
    """Texts that nobody would write, for the tokenizer: words run together, and characters at random."""
    rng = random.Random(seed)
    words = ["".join(rng.choice(NOISE_WORDS) + rng.choice([" ", " ", "", ",", ". "]) for _ in range(rng.randint(1, 8))) for _ in range(n)]
    characters = ["".join(rng.choice(NOISE_CHARACTERS) for _ in range(rng.randint(2, 14))) for _ in range(n)]
    return words + characters
