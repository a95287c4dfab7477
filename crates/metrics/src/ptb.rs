//! Penn Treebank tokens as the COCO caption evaluation makes them: Stanford's PTBTokenizer 3.4.1 with
//! `-preserveLines -lowerCase`, then pycocoevalcap's list of punctuation is dropped.
//!
//! At each position, every rule is tried. The rule that reads the most text wins, including text that it only looks
//! ahead at; on a tie, the first of them wins. The test `tests/it/tokens.rs` compares the rules with the tokenizer's
//! output. Characters outside the basic multilingual plane are dropped, as in the original.
//!
//! There is one intentional difference: captions are processed one by one. The original reads them as lines of one text
//! and looks across line ends, so that "2.5 m." before a caption that starts with "The " loses its dot.

/// Tokens that pycocoevalcap drops. The brackets in lower case are not among them.
const DROPPED: [&str; 17] = [
    "''", "'", "``", "`", "-LRB-", "-RRB-", "-LCB-", "-RCB-", ".", "?", "!", ",", ":", "-", "--",
    "...", ";",
];

/// Tokens of one caption. Line ends within it count as spaces.
pub fn ptb(text: &str) -> Vec<String> {
    let mut s: Vec<char> = text
        .chars()
        .map(|c| if c == '\n' { ' ' } else { c })
        .collect();
    while s.last().is_some_and(|c| is_space(*c)) {
        s.pop();
    }
    // The end of a caption is the end of a line.
    s.push('\n');
    let mut tokens = Vec::new();
    let mut at = 0;
    while at < s.len() - 1 {
        if is_space(s[at]) || !is_basic(s[at]) {
            at += 1;
            continue;
        }
        let (taken, token) = next(&Text { s: &s, at });
        if let Some(token) = token {
            let token = token.to_lowercase();
            if !token.is_empty() && !DROPPED.contains(&token.as_str()) {
                tokens.push(token);
            }
        }
        at += taken.max(1);
    }
    tokens
}

/// The best rule so far.
struct Best {
    /// Number of characters read, including those that are only looked ahead at.
    seen: usize,
    /// Number of characters consumed.
    taken: usize,
    token: Option<String>,
}

impl Best {
    fn offer(&mut self, seen: usize, taken: usize, token: impl FnOnce() -> String) {
        if seen > self.seen {
            (self.seen, self.taken, self.token) = (seen, taken, Some(token()));
        }
    }
}

/// Returns the number of characters consumed, and the token if a rule matched.
fn next(t: &Text) -> (usize, Option<String>) {
    let mut best = Best {
        seen: 0,
        taken: 1,
        token: None,
    };
    let own = |n: usize| t.take(n);
    words(t, &mut best);
    addresses(t, &mut best);
    // n't and 's after the word before them has been consumed.
    if let Some(n) = t.contraction() {
        let followed = usize::from(!t.char(n).is_ascii_alphabetic());
        if followed == 1 {
            best.offer(n + 1, n, || straight(&own(n)));
        }
    }
    if t.is_not(0) {
        best.offer(3, 3, || straight(&own(3)));
    }
    numbers(t, &mut best);
    abbreviations(t, &mut best);
    marks(t, &mut best);
    compounds(t, &mut best);
    quotes(t, &mut best);
    (best.taken, best.token)
}

/// Words of letters, contractions, and words with apostrophes.
fn words(t: &Text, best: &mut Best) {
    let own = |n: usize| t.take(n);
    for language in ["c++", "c#", "f#"] {
        if t.has(0, language) {
            best.offer(language.len(), language.len(), || own(language.len()));
        }
    }
    for (word, back) in [
        ("cannot", 3),
        ("'twas", 3),
        ("gonna", 2),
        ("gotta", 2),
        ("lemme", 2),
        ("gimme", 2),
        ("wanna", 2),
    ] {
        if t.has(0, word) {
            best.offer(word.len(), word.len() - back, || own(word.len() - back));
        }
    }
    if t.has(0, "'tis") {
        best.offer(4, 2, || own(2));
    }
    if let Some(n) = t.markup() {
        best.offer(n, n, || own(n).replace(' ', "\u{a0}"));
    }
    if let Some(n) = t.entity(&["MD", "mdash", "ndash"]) {
        best.offer(n, n, || "--".into());
    }
    if let Some(n) = t.entity(&["amp"]) {
        best.offer(n, n, || "&".into());
    }
    if let Some(n) = t.entity(&["HT", "TL", "UR", "LR", "QC", "QL", "QR", "odq", "cdq"]) {
        best.offer(n, n, || own(n));
    }
    let digits = t.count(2, |c| c.is_ascii_digit());
    if t.has(0, "&#") && digits > 0 && t.char(2 + digits) == ';' {
        best.offer(digits + 3, digits + 3, || own(digits + 3));
    }
    let word = t.word(0);
    if word > 0 {
        let after = Text {
            s: t.s,
            at: t.at + word,
        };
        if let Some(n) = after.contraction() {
            best.offer(word + n, word, || soft(&own(word)));
        }
    }
    // doesn't becomes does and n't. The last letter before n't is not an n.
    let run = t.count(0, |c| c.is_ascii_alphabetic() || c == SOFT_HYPHEN);
    for n in (1..=run).rev().filter(|&n| t.is_not(n)) {
        let letters = own(n);
        let last = letters.trim_end_matches(SOFT_HYPHEN).chars().last();
        if last.is_some_and(|c| !matches!(c, 'n' | 'N')) {
            best.offer(n + 3, n, || soft(&letters));
        }
    }
    if word > 0 {
        best.offer(word, word, || soft(&own(word)));
    }
    if let Some(n) = t.apostrophe_word() {
        best.offer(n, n, || own(n));
    }
    // y'all
    if t.has(0, "y") && is_apostrophe(t.char(1)) && is_plain_letter(t.char(2)) {
        best.offer(3, 2, || own(2));
    }
}

/// Internet addresses.
fn addresses(t: &Text, best: &mut Best) {
    for n in [t.url(), t.likely_url(), t.mail()].into_iter().flatten() {
        best.offer(n, n, || t.take(n));
    }
    if t.char(0) == '@' && (t.char(1).is_ascii_alphabetic() || t.char(1) == '_') {
        let n = 1 + t.count(1, |c| c.is_ascii_alphanumeric() || c == '_');
        best.offer(n, n, || t.take(n));
    }
    if t.char(0) == '#' {
        let n = t.count(1, is_letter);
        if n > 0 {
            best.offer(n + 1, n + 1, || t.take(n + 1));
        }
    }
}

fn numbers(t: &Text, best: &mut Best) {
    let own = |n: usize| t.take(n);
    let start = Ends(vec![0]);
    let date = start
        .digits(t, 1, 2)
        .one(t, "-/")
        .digits(t, 1, 2)
        .one(t, "-/")
        .digits(t, 2, 4);
    if let Some(n) = date.longest() {
        best.offer(n, n, || own(n));
    }
    if let Some(n) = t.number() {
        best.offer(n, n, || soft(&own(n)));
    }
    let sign = usize::from("\u{207a}\u{207b}\u{208a}\u{208b}".contains(t.char(0)));
    let superscript = t.count(sign, |c| {
        matches!(
            c,
            '\u{2070}' | '\u{b9}' | '\u{b2}' | '\u{b3}' | '\u{2074}'..='\u{2079}'
        )
    });
    let subscript = t.count(sign, |c| matches!(c, '\u{2080}'..='\u{2089}'));
    let n = superscript.max(subscript);
    if n > 0 {
        best.offer(sign + n, sign + n, || own(sign + n));
    }
    let whole = start.digits(t, 1, 4).one(t, "- \u{a0}").or(&start);
    let top = whole.digits(t, 1, 4);
    let bar = top
        .one(t, "\\")
        .or(&top)
        .one(t, "/")
        .or(&top.one(t, "\u{2044}"));
    if let Some(n) = bar.digits(t, 1, 4).longest() {
        best.offer(n, n, || own(n).replace(' ', "\u{a0}"));
    }
    if matches!(t.char(0), '\u{bc}'..='\u{be}' | '\u{2153}'..='\u{215e}') {
        best.offer(1, 1, || {
            match t.char(0) {
                '\u{bc}' => "1/4",
                '\u{bd}' => "1/2",
                '\u{be}' => "3/4",
                '\u{2153}' => "1/3",
                '\u{2154}' => "2/3",
                other => return other.to_string(),
            }
            .to_string()
        });
    }
    for special in [
        "-RRB-", "-LRB-", "-RCB-", "-LCB-", "-RSB-", "-LSB-", "C.D.s", "pro-", "anti-", "S&P-500",
        "S&Ls",
    ] {
        if t.has(0, special) {
            best.offer(special.len(), special.len(), || own(special.len()));
        }
    }
    if let Some(n) = t.slashed() {
        best.offer(n, n, || own(n));
    }
    let capitals = t.count(0, |c| c.is_ascii_uppercase());
    if t.char(capitals) == '$' {
        best.offer(capitals + 1, capitals + 1, || own(capitals + 1));
    }
    if t.char(0) == '#' {
        best.offer(1, 1, || own(1));
    }
    let currency = match t.char(0) {
        '\u{a2}' => Some("cents".to_string()),
        '\u{a3}' => Some("#".into()),
        '\u{a4}' | '\u{80}' | '\u{20a0}' | '\u{20ac}' => Some("$".into()),
        c @ ('\u{a5}' | '\u{60b}' | '\u{e3f}' | '\u{20a4}' | '\u{ffe0}' | '\u{ffe1}'
        | '\u{ffe5}' | '\u{ffe6}') => Some(c.to_string()),
        _ => None,
    };
    if let Some(currency) = currency {
        best.offer(1, 1, || currency);
    }
}

/// Abbreviations that keep their dot anywhere, also at the end of a sentence. Those listed with a capital letter match
/// only with the capital.
const ABBREVIATIONS: &str = "jan feb mar apr jun jul aug sep sept oct nov dec mon tue tues wed thu thurs fri \
    ala ariz Az Ark calif colo conn ct dak Del fla ga Ill ind kan kans ky La Mass md mich minn Miss mo mont neb nev \
    okla Ore Pa penn tenn Tex va vt Wash wis wisc wyo inc co cos corp pty ppty pte ptys ltd plc rt bancorp bhd assn univ intl sys \
    tel est ext sq jr sr bros ed.d ph.d esq etc al seq bldg";
/// Abbreviations that another word usually follows, such as titles.
const TITLES: &str = "mr mrs ms dr drs prof profs sen sens rep reps atty attys lt col gen messrs gov govs adm rev maj sgt cpl pvt mt ft \
    capt st ste ave pres lieut hon brig comdr cmdr pfc spc supt supts det \
    vs v alex wm jos cie a.k.a cf treas ph invt elec natl mtg mfg dept blvd rd \
    mlle mme adj adv asst assoc insp ens msgr sfc";
/// Words that start a sentence. The dot between a single letter and one of these words ends the sentence and is not
/// part of the letter's token.
const SENTENCE_STARTS: &str = "About According Additionally After An A As At But Earlier He Her Here However If In It Last \
    Many More Mr. Ms. Now Once One Other Our She Since So Some Such That The Their Then There These They This We When \
    While What Yet You";
/// Abbreviations that keep their dot before a number.
const BEFORE_NUMBERS: [&str; 9] = ["ca", "fig", "figs", "prop", "no", "nos", "art", "pp", "op"];
const COUNTRIES: [&str; 7] = [
    "Canada-U.S",
    "Sino-U.S",
    "Korean-U.S",
    "EU-U.S",
    "Japan-U.S",
    "non-U.S",
    "U.S.-U.K",
];

fn abbreviations(t: &Text, best: &mut Best) {
    let own = |n: usize| t.take(n);
    for word in BEFORE_NUMBERS {
        if t.has(0, word) && t.char(word.len()) == '.' {
            let after = word.len() + 1;
            let space = usize::from(is_space(t.char(after)));
            if is_digit(t.char(after + space)) {
                best.offer(after + space + 1, after, || own(after));
            }
        }
    }
    let mut abbreviation = |n: usize, ends_sentences: bool| {
        // An abbreviation that may end a sentence looks ahead at two characters.
        if t.char(n) == '.' && ends_sentences {
            best.offer(n + 3, n + 1, || own(n + 1));
        }
        if t.char(n) == '.' {
            best.offer(n + 1, n + 1, || own(n + 1));
        }
        if is_space(t.char(n)) || t.char(n) == '\n' {
            best.offer(n + 1, n, || own(n));
        }
    };
    for (list, ends_sentences) in [(ABBREVIATIONS, true), (TITLES, false)] {
        for word in list.split_ascii_whitespace() {
            let capital = word.starts_with(|c: char| c.is_ascii_uppercase());
            if t.has(0, word) && (!capital || word.starts_with(t.char(0))) {
                abbreviation(word.len(), ends_sentences);
            }
        }
    }
    let acronyms = t.acronyms();
    for &n in &acronyms {
        abbreviation(n, false);
    }
    for name in COUNTRIES.into_iter().chain(["U.S.-U.S.S.R"]) {
        if t.has(0, name) {
            abbreviation(name.len(), false);
        }
    }
    for n in acronyms {
        let spaces = if t.char(n) == '.' {
            t.count(n + 1, is_space)
        } else {
            0
        };
        let start = n + 1 + spaces;
        let tag = Text {
            s: t.s,
            at: t.at + start,
        }
        .markup();
        let follows = |word: &str| {
            word.chars().enumerate().all(|(k, c)| {
                t.char(start + k) == c || k > 0 && t.char(start + k).eq_ignore_ascii_case(&c)
            })
        };
        let words = SENTENCE_STARTS
            .split_ascii_whitespace()
            .filter(|w| follows(w));
        for end in words.map(str::len).chain(tag).map(|len| start + len) {
            if spaces > 0 && (is_space(t.char(end)) || t.char(end) == '\n') {
                let taken = if n == 1 { 1 } else { n + 1 };
                best.offer(end + 1, taken, || own(taken));
            }
        }
    }
    // A year such as '90 at the end of a word.
    let is_year =
        is_apostrophe(t.char(0)) && t.char(1).is_ascii_digit() && t.char(2).is_ascii_digit();
    if is_year && (is_space(t.char(3)) || t.char(3) == '\n') {
        best.offer(4, 3, || own(3));
    }
    let word = t.word(0);
    if word > 0 && t.char(word) == '.' && is_inner_mark(t.char(word + 1)) {
        best.offer(word + 2, word + 1, || soft(&own(word + 1)));
    }
    if let Some(n) = t.phone() {
        best.offer(n, n, || {
            own(n)
                .replace(' ', "\u{a0}")
                .replace('(', "-LRB-")
                .replace(')', "-RRB-")
        });
    }
}

fn marks(t: &Text, best: &mut Best) {
    let own = |n: usize| t.take(n);
    if let Some(n) = t.double_quote() {
        best.offer(n, n, String::new);
    }
    if t.has(0, "&nbsp;") {
        best.offer(6, 6, String::new);
    }
    for (entity, sign) in [("&lt;", "<"), ("&gt;", ">")] {
        if t.has(0, entity) {
            best.offer(4, 4, || sign.into());
        }
    }
    if let Some(n) = t.smiley() {
        let token = own(n).replace('(', "-LRB-").replace(')', "-RRB-");
        best.offer(n + 1, n, || token);
    }
    if "-^x=~<>'".contains(t.char(0)) && t.char(1) == '_' && "-^x=~<>'".contains(t.char(2)) {
        best.offer(3, 3, || own(3));
    }
    let face = |i: usize| "-^x=~<>'".contains(t.char(i));
    let middle = usize::from("_.".contains(t.char(2)));
    if t.char(0) == '(' && face(1) && face(2 + middle) && t.char(3 + middle) == ')' {
        let inner: String = own(3 + middle).chars().skip(1).collect();
        best.offer(4 + middle, 4 + middle, || format!("-LRB-{inner}-RRB-"));
    }
    let bracket = match t.char(0) {
        '{' => "-LCB-",
        '}' => "-RCB-",
        '[' => "-LSB-",
        ']' => "-RSB-",
        '(' => "-LRB-",
        ')' => "-RRB-",
        _ => "",
    };
    if !bracket.is_empty() {
        // In lower case, so that the token is not dropped.
        best.offer(1, 1, || bracket.to_ascii_lowercase());
    }
    let run = |mark: char| t.count(0, |c| c == mark);
    let hyphens = run('-');
    if hyphens > 0 {
        let dash = matches!(hyphens, 3 | 4);
        best.offer(hyphens, hyphens, || {
            if dash { "--".into() } else { own(hyphens) }
        });
    }
    for n in [
        run('@'),
        run('#'),
        run('_'),
        run('*'),
        t.count(0, |c| c == '?' || c == '!'),
    ] {
        if n > 0 {
            best.offer(n, n, || own(n));
        }
    }
    let escaped = (0..3).take_while(|i| t.has(2 * i, "\\*")).count() * 2;
    if escaped > 0 {
        best.offer(escaped, escaped, || own(escaped));
    }
    if let Some(n) = t.dots() {
        best.offer(n, n, String::new);
    }
    if matches!(t.char(0), '\u{96}' | '\u{97}' | '\u{2013}'..='\u{2015}') {
        best.offer(1, 1, || "--".into());
    }
    if is_single_mark(t.char(0)) {
        best.offer(1, 1, || own(1));
    }
    for twice in ["<<", ">>"] {
        if t.has(0, twice) {
            best.offer(2, 2, || own(2));
        }
    }
}

/// Words with hyphens, digits or `&` in them.
fn compounds(t: &Text, best: &mut Best) {
    let own = |n: usize| t.take(n);
    for n in [t.hyphenated(), t.thing()].into_iter().flatten() {
        if t.char(n) == '.' && is_inner_mark(t.char(n + 1)) {
            best.offer(n + 2, n + 1, || soft(&own(n + 1)));
        }
        best.offer(n, n, || soft(&own(n)));
    }
    if let Some(n) = t.initials() {
        let plain = |n| own(n).replace("&amp;", "&");
        if t.char(n) == '.' && is_inner_mark(t.char(n + 1)) {
            best.offer(n + 2, n + 1, || plain(n + 1));
        }
        best.offer(n, n, || plain(n));
    }
}

fn quotes(t: &Text, best: &mut Best) {
    let own = |n: usize| t.take(n);
    if t.char(0) == '\''
        && t.char(1).is_ascii_alphabetic()
        && !is_space(t.char(2))
        && t.char(2) != '\n'
    {
        best.offer(3, 1, || "`".into());
    }
    if let Some(n) = t.contraction() {
        best.offer(n, n, || straight(&own(n)));
    }
    let n = t.count(0, is_quote).min(2);
    let n = if t.has(0, "''") {
        2
    } else {
        n.max(usize::from(is_apostrophe(t.char(0))))
    };
    if n > 0 {
        best.offer(n, n, || straight(&own(n)));
    }
    if t.has(0, "&apos;") {
        best.offer(6, 6, || "'".into());
    }
}

/// A position in a text that ends with a line end.
struct Text<'a> {
    s: &'a [char],
    at: usize,
}

impl Text<'_> {
    fn char(&self, i: usize) -> char {
        self.s.get(self.at + i).copied().unwrap_or('\n')
    }

    fn take(&self, n: usize) -> String {
        self.s[self.at..(self.at + n).min(self.s.len())]
            .iter()
            .collect()
    }

    /// Whether `text` starts at `i`, ignoring ASCII case.
    fn has(&self, i: usize, text: &str) -> bool {
        text.chars()
            .enumerate()
            .all(|(k, c)| self.char(i + k).eq_ignore_ascii_case(&c))
    }

    fn count(&self, i: usize, fits: impl Fn(char) -> bool) -> usize {
        self.s
            .get(self.at + i..)
            .map_or(0, |s| s.iter().take_while(|c| fits(**c)).count())
    }

    /// Length of a character entity `&name;` with one of `names`.
    fn entity(&self, names: &[&str]) -> Option<usize> {
        let name = names
            .iter()
            .find(|n| self.char(0) == '&' && self.has(1, n) && self.char(1 + n.len()) == ';')?;
        Some(name.len() + 2)
    }

    /// Length of a letter, which may be a character entity of an accented letter; 0 if there is none.
    fn letter(&self, i: usize) -> usize {
        if is_letter(self.char(i)) {
            return 1;
        }
        let accent = ["acute", "grave", "uml"].iter().find(|a| {
            self.char(i) == '&'
                && "aeiouAEIOU".contains(self.char(i + 1))
                && self.has(i + 2, a)
                && self.char(i + 2 + a.len()) == ';'
        });
        accent.map_or(0, |a| a.len() + 3)
    }

    /// Length of a letter followed by letters and digits.
    fn letters(&self, i: usize) -> usize {
        let mut n = 0;
        loop {
            match self.letter(i + n) {
                0 if n > 0 && is_digit(self.char(i + n)) => n += 1,
                0 => return n,
                more => n += more,
            }
        }
    }

    /// Length of runs of letters and digits that start with a letter, joined by single dots, exclamation marks or
    /// question marks.
    fn word(&self, i: usize) -> usize {
        let mut n = self.letters(i);
        while n > 0 && ".!?".contains(self.char(i + n)) {
            match self.letters(i + n + 1) {
                0 => break,
                more => n += 1 + more,
            }
        }
        n
    }

    /// Length of 's, 'm, 'd, 're, 've or 'll.
    fn contraction(&self) -> Option<usize> {
        let n = if self.has(0, "&apos;") {
            6
        } else {
            usize::from(is_apostrophe(self.char(0)))
        };
        let long = ["re", "ve", "ll"].iter().any(|s| self.has(n, s));
        let short = "msdMSD".contains(self.char(n));
        match (n, long, short) {
            (0, _, _) | (_, false, false) => None,
            (_, true, _) => Some(n + 2),
            _ => Some(n + 1),
        }
    }

    fn is_not(&self, i: usize) -> bool {
        self.has(i, "n") && is_inner_apostrophe(self.char(i + 1)) && self.has(i + 2, "t")
    }

    /// Length of the longest word that contains an apostrophe, or starts or ends with one.
    fn apostrophe_word(&self) -> Option<usize> {
        let mut longest = 0;
        let mut offer = |n: usize| longest = longest.max(n);
        let first = is_apostrophe(self.char(0));
        for word in ["n", "em", "til", "till", "cause"] {
            if first && self.has(1, word) {
                offer(1 + word.len());
            }
        }
        if first && self.has(1, "n") && is_apostrophe(self.char(2)) {
            offer(3);
        }
        if first && matches!(self.char(1), '2'..='9') && self.has(2, "0s") {
            offer(4);
        }
        for word in ["l", "d", "j", "dunkin", "somethin", "ol"] {
            if self.has(0, word) && is_apostrophe(self.char(word.len())) {
                offer(word.len() + 1);
            }
        }
        for (before, after) in [("cap", "n"), ("c", "est")] {
            if self.has(0, before)
                && is_apostrophe(self.char(before.len()))
                && self.has(before.len() + 1, after)
            {
                offer(before.len() + 1 + after.len());
            }
        }
        for word in [
            "cont'd.",
            "cont'd",
            "nor'easter",
            "c'mon",
            "e'er",
            "s'mores",
            "ev'ry",
            "li'l",
            "nat'l",
        ] {
            if self.has(0, word) {
                offer(word.len());
            }
        }
        if self.has(0, "o") && is_inner_apostrophe(self.char(1)) && self.has(2, "o") {
            offer(3);
        }
        // O'Neil
        if matches!(self.char(0), 'A'..='H' | 'J'..='X' | 'Z' | 'n')
            && is_inner_apostrophe(self.char(1))
        {
            let more = self.count(2, is_plain_letter);
            if more >= 2 {
                offer(2 + more);
            }
        }
        // ma'am
        let run = self.count(0, is_plain_letter);
        let vowel_before = run > 1 && "aeiouyAEIOUY".contains(self.char(run - 1));
        if vowel_before && is_inner_apostrophe(self.char(run)) {
            let next = self.char(run + 1);
            if "aeiou".contains(next) || next.is_ascii_uppercase() {
                offer(run + 1 + self.count(run + 1, is_plain_letter));
            }
        }
        (longest > 0).then_some(longest)
    }

    /// Length of a tag with quoted or bare attributes, or of a declaration.
    fn markup(&self) -> Option<usize> {
        if self.char(0) != '<' {
            return None;
        }
        if "!?".contains(self.char(1))
            && (self.char(2).is_ascii_alphabetic() || self.char(2) == '-')
        {
            let n = 3 + self.count(3, |c| !matches!(c, '>' | '\r' | '\n'));
            return (self.char(n) == '>').then_some(n + 1);
        }
        let is_name = |c: char| c.is_ascii_alphanumeric() || matches!(c, ':' | '.' | '-');
        let spaces = |i: usize| self.count(i, |c| c == ' ');
        let quoted = |i: usize| -> Option<usize> {
            if !"'\"".contains(self.char(i)) {
                return None;
            }
            let inner = self.count(i + 1, |c| !matches!(c, '\'' | '"' | '\r' | '\n'));
            "'\""
                .contains(self.char(i + 1 + inner))
                .then_some(i + inner + 2)
        };
        let mut i = 1 + usize::from(self.char(1) == '/');
        if !self.char(i).is_ascii_alphabetic() {
            return None;
        }
        i += self.count(i, is_name);
        loop {
            let start = i + spaces(i);
            if self.char(start) == '>' {
                return Some(start + 1);
            }
            if start == i {
                return None;
            }
            i = if self.char(start) == '/' {
                start + 1
            } else if let Some(end) = quoted(start) {
                end
            } else if self.char(start).is_ascii_alphabetic() {
                let end = start + self.count(start, is_name);
                let equals = end + spaces(end);
                match self.char(equals) {
                    '=' => quoted(equals + 1 + spaces(equals + 1))?,
                    _ => end,
                }
            } else {
                return None;
            };
        }
    }

    fn url(&self) -> Option<usize> {
        let scheme = ["http://", "https://"]
            .into_iter()
            .find(|s| self.has(0, s))?;
        self.url_tail(scheme.len())
    }

    /// End of the longest text from `i` that has at least two characters and does not end with one of `.!?{},-`.
    fn url_tail(&self, i: usize) -> Option<usize> {
        let run = self.count(i, |c| {
            !is_space(c) && !"\n\r\u{c}\"<>|()".contains(c) || c == '\u{a0}'
        });
        (i + 2..=i + run)
            .rev()
            .find(|end| !".!?{},-".contains(self.char(end - 1)))
    }

    fn likely_url(&self) -> Option<usize> {
        let part = |c: char| !is_space(c) && !"\n\r\u{c}\"<>|.!?(){},".contains(c);
        let mut ends = Vec::new();
        if self.has(0, "www.") {
            let mut i = 4;
            loop {
                let n = self.count(i, part);
                if n == 0 || self.char(i + n) != '.' {
                    break;
                }
                i += n + 1;
                let top = self.count(i, |c| c.is_ascii_alphabetic()).min(4);
                ends.extend((2..=top).map(|k| i + k));
            }
        }
        // The original's character class has a range from `,` to `_`, which also excludes digits, capitals and hyphens.
        let name = |c: char| part(c) && !(','..='_').contains(&c) && !"`'$".contains(c);
        let mut i = 0;
        loop {
            let n = self.count(i, name);
            if n == 0 || self.char(i + n) != '.' {
                break;
            }
            i += n + 1;
            if ["com", "net", "org", "edu"]
                .iter()
                .any(|top| self.has(i, top))
            {
                ends.push(i + 3);
            }
        }
        ends.into_iter()
            .flat_map(|end| {
                let path = (self.char(end) == '/')
                    .then(|| self.url_tail(end + 1))
                    .flatten();
                [Some(end), path]
            })
            .flatten()
            .max()
    }

    fn mail(&self) -> Option<usize> {
        let bracket = |i: usize, signs: [&str; 2]| {
            signs.iter().find(|s| self.has(i, s)).map_or(0, |s| s.len())
        };
        let start = bracket(0, ["&lt;", "<"]);
        if !self.char(start).is_ascii_alphanumeric() {
            return None;
        }
        let stops = |c: char| c == ' ' || "\t\n\u{c}\r\"<>|(){}\u{a0}".contains(c);
        let run = start + self.count(start, |c| !stops(c));
        // The last @ that is followed by a character other than a dot.
        let at = (start + 1..run)
            .rev()
            .find(|&i| self.char(i) == '@' && self.char(i + 1) != '.' && i + 1 < run)?;
        let mut end = at + 1;
        loop {
            end += self.count(end, |c| !stops(c) && c != '.');
            if self.char(end) != '.' || end + 1 >= run || self.char(end + 1) == '.' {
                return Some(end + bracket(end, ["&gt;", ">"]));
            }
            end += 1;
        }
    }

    /// Length of a number: digits with dots, commas or colons before and between them, and an optional sign.
    fn number(&self) -> Option<usize> {
        let sign = usize::from("+-".contains(self.char(0)));
        let digits = |i: usize| self.count(i, is_digit);
        let mut end = sign + digits(sign);
        while ".:,\u{ad}\u{66b}\u{66c}".contains(self.char(end)) && digits(end + 1) > 0 {
            end += 1 + digits(end + 1);
        }
        (end > sign).then_some(end)
    }

    /// Length of words joined by slashes, for example walks/runs and half-way/full-turn.
    fn slashed(&self) -> Option<usize> {
        let part = |from: &Ends| {
            let word = from.run(self, |c| c.is_ascii_alphanumeric());
            let one = word.or(&word.one(self, "-").run(self, |c| c.is_ascii_alphabetic()));
            one.or(&one.one(self, "-").run(self, |c| c.is_ascii_alphabetic()))
        };
        let slash = |from: &Ends| from.one(self, "\\").or(from).one(self, "/");
        let first = part(&Ends(vec![0]));
        let second = part(&slash(&first));
        second.or(&part(&slash(&second))).longest()
    }

    /// Possible lengths of letters joined by dots: a, a.b, a.b.c.
    fn acronyms(&self) -> Vec<usize> {
        let mut out = Vec::new();
        let mut n = 0;
        while self.char(n).is_ascii_alphabetic() {
            n += 1;
            out.push(n);
            if self.char(n) != '.' {
                break;
            }
            n += 1;
        }
        out
    }

    fn phone(&self) -> Option<usize> {
        let start = Ends(vec![0]);
        let gap = "- \u{a0}";
        let plus = start
            .or(&start.one(self, "+"))
            .or(&start.one(self, "+").one(self, "+"));
        let bracketed = start.one(self, "(").digits_ascii(self, 2, 3).one(self, ")");
        let area = bracketed.or(&bracketed.one(self, " \u{a0}"));
        let country = plus.or(&plus.digits_ascii(self, 2, 4).one(self, gap));
        let prefix = area.or(&country.digits_ascii(self, 2, 4).one(self, gap));
        let middle = prefix.digits_ascii(self, 3, 4);
        let spaced = middle.or(&middle.one(self, gap)).digits_ascii(self, 3, 5);
        let dotted = start.or(&plus.digits_ascii(self, 2, 4).one(self, "."));
        let dotted = dotted
            .digits_ascii(self, 2, 4)
            .one(self, ".")
            .digits_ascii(self, 3, 4);
        spaced
            .or(&dotted.one(self, ".").digits_ascii(self, 3, 5))
            .longest()
    }

    fn double_quote(&self) -> Option<usize> {
        match self.char(0) {
            '"' => Some(1),
            _ => self.has(0, "&quot;").then_some(6),
        }
    }

    fn smiley(&self) -> Option<usize> {
        let mut n = usize::from("<>".contains(self.char(0)));
        if !":;=".contains(self.char(n)) {
            return None;
        }
        n += 1;
        let ends = |i: usize| {
            "()DPdpO\\{@|[]".contains(self.char(i)) && !self.char(i + 1).is_ascii_alphanumeric()
        };
        [n + usize::from("-o*'".contains(self.char(n))), n]
            .into_iter()
            .find(|&i| ends(i))
            .map(|i| i + 1)
    }

    /// Length of three or more dots, of dots separated by spaces, or of an ellipsis.
    fn dots(&self) -> Option<usize> {
        if matches!(self.char(0), '\u{85}' | '\u{2026}') {
            return Some(1);
        }
        let run = self.count(0, |c| c == '.').min(5);
        let mut spaced = 0;
        while spaced < 4
            && self.char(2 * spaced) == '.'
            && matches!(self.char(2 * spaced + 1), ' ' | '\u{a0}')
        {
            spaced += 1;
        }
        while spaced >= 2 && self.char(2 * spaced) != '.' {
            spaced -= 1;
        }
        let spaced = if spaced >= 2 { 2 * spaced + 1 } else { 0 };
        let run = if run >= 3 { run } else { 0 };
        (run.max(spaced) > 0).then_some(run.max(spaced))
    }

    /// Length of a hyphenated word, for example half-turn, x,y-z or 1,000-fold. Dots and commas may occur before the
    /// first hyphen.
    fn hyphenated(&self) -> Option<usize> {
        if !self.char(0).is_ascii_alphanumeric() {
            return None;
        }
        let part = |c: char| c.is_ascii_alphanumeric() || c == SOFT_HYPHEN;
        let mut end = self.count(0, |c| part(c) || c == '.' || c == ',');
        let mut found = None;
        while self.char(end) == '-' {
            let word = self.count(end + 1, part);
            let after = Text {
                s: self.s,
                at: self.at + end + 1,
            };
            let acronym = after
                .acronyms()
                .into_iter()
                .rev()
                .find(|&n| n > 1 && after.char(n) == '.');
            let n = word.max(acronym.map_or(0, |n| n + 1));
            if n == 0 {
                break;
            }
            end += 1 + n;
            found = Some(end);
        }
        found
    }

    /// Length of letters and digits joined by hyphens or underscores. Each part may start with d', o' or l'.
    fn thing(&self) -> Option<usize> {
        let part = |i: usize| -> usize {
            let alnum = |c: char| is_plain_letter(c) || is_digit(c);
            let led = "dDoOlL".contains(self.char(i)) && is_inner_apostrophe(self.char(i + 1));
            let after = self.count(i + 2, alnum);
            let plain = self.count(i, alnum);
            if led && after > 1 { 2 + after } else { plain }
        };
        let mut end = part(0);
        if end == 0 {
            return None;
        }
        while "-_\u{58a}\u{2010}\u{2011}".contains(self.char(end)) {
            match part(end + 1) {
                0 => break,
                n => end += 1 + n,
            }
        }
        Some(end)
    }

    /// Length of capitals joined by `&` or `+`, for example R&D and A+B.
    fn initials(&self) -> Option<usize> {
        let capitals = |i: usize| self.count(i, |c| c.is_ascii_uppercase());
        let mut end = capitals(0);
        let mut found = None;
        while end > 0 {
            let sign = if self.has(end, "&amp;") {
                5
            } else {
                usize::from("+&".contains(self.char(end)))
            };
            let more = if sign > 0 { capitals(end + sign) } else { 0 };
            if more == 0 {
                break;
            }
            end += sign + more;
            found = Some(end);
        }
        found
    }
}

/// The positions at which a pattern with alternatives can end.
#[derive(Clone)]
struct Ends(Vec<usize>);

impl Ends {
    fn one(&self, t: &Text, set: &str) -> Self {
        Self(
            self.0
                .iter()
                .filter(|&&i| set.contains(t.char(i)))
                .map(|i| i + 1)
                .collect(),
        )
    }

    fn times(&self, t: &Text, min: usize, max: usize, fits: impl Fn(char) -> bool) -> Self {
        let mut out: Vec<usize> = Vec::new();
        for &i in &self.0 {
            let n = (0..max).take_while(|k| fits(t.char(i + k))).count();
            out.extend((min..=n).map(|k| i + k));
        }
        out.sort_unstable();
        out.dedup();
        Self(out)
    }

    fn digits(&self, t: &Text, min: usize, max: usize) -> Self {
        self.times(t, min, max, is_digit)
    }

    fn digits_ascii(&self, t: &Text, min: usize, max: usize) -> Self {
        self.times(t, min, max, |c| c.is_ascii_digit())
    }

    /// Consumes whole runs. Shorter runs need not be tried, because no pattern here continues with a character of the
    /// run's class.
    fn run(&self, t: &Text, fits: impl Fn(char) -> bool) -> Self {
        let ends = self.0.iter().map(|&i| (i, t.count(i, &fits)));
        Self(ends.filter(|(_, n)| *n > 0).map(|(i, n)| i + n).collect())
    }

    fn or(&self, other: &Self) -> Self {
        Self(self.0.iter().chain(&other.0).copied().collect())
    }

    fn longest(&self) -> Option<usize> {
        self.0.iter().copied().max().filter(|n| *n > 0)
    }
}

const SOFT_HYPHEN: char = '\u{ad}';

/// Removes soft hyphens. A token of soft hyphens alone becomes a hyphen.
fn soft(token: &str) -> String {
    match token.replace(SOFT_HYPHEN, "") {
        empty if empty.is_empty() => "-".into(),
        other => other,
    }
}

/// Replaces quotation marks by ' and `.
fn straight(token: &str) -> String {
    let token = token.replace("&apos;", "'");
    let mut out = String::new();
    for c in token.chars() {
        match c {
            '\u{2018}' | '\u{201b}' | '\u{2039}' | '\u{91}' => out.push('`'),
            '\u{2019}' | '\u{203a}' | '\u{92}' => out.push('\''),
            '\u{201c}' | '\u{ab}' | '\u{93}' => out.push_str("``"),
            '\u{201d}' | '\u{bb}' | '\u{94}' => out.push_str("''"),
            other => out.push(other),
        }
    }
    out
}

fn is_basic(c: char) -> bool {
    c <= '\u{ffff}'
}

fn is_space(c: char) -> bool {
    matches!(
        c,
        ' ' | '\t' | '\r' | '\u{b}' | '\u{c}' | '\u{a0}' | '\u{2000}'
            ..='\u{200b}'
                | '\u{200e}'
                | '\u{200f}'
                | '\u{2028}'
                | '\u{2029}'
                | '\u{3000}'
                | '\u{feff}'
                | '\0'
    )
}

fn is_apostrophe(c: char) -> bool {
    matches!(c, '\'' | '\u{92}' | '\u{2019}')
}

/// Apostrophes within words, including quotation marks that are used instead by mistake.
fn is_inner_apostrophe(c: char) -> bool {
    is_apostrophe(c) || matches!(c, '`' | '\u{91}' | '\u{2018}' | '\u{201b}')
}

fn is_quote(c: char) -> bool {
    matches!(c, '`' | '\u{2018}'..='\u{201f}' | '\u{91}'..='\u{94}' | '\u{2039}' | '\u{203a}' | '\u{ab}' | '\u{bb}')
}

fn is_inner_mark(c: char) -> bool {
    matches!(c, ',' | ';' | ':' | '\u{3001}')
}

/// Unicode's letters of the basic multilingual plane, without letter numbers and combining marks.
fn is_plain_letter(c: char) -> bool {
    is_basic(c) && c.is_alphabetic() && !c.is_numeric() && !is_mark(c)
}

/// Letters, soft hyphens, and marks that stand on or between letters.
fn is_letter(c: char) -> bool {
    is_plain_letter(c)
        || c == SOFT_HYPHEN
        || is_mark(c)
        || matches!(c, '\u{2c2}'..='\u{2c5}' | '\u{2d2}'..='\u{2df}' | '\u{2e5}'..='\u{2ff}' | '\u{375}' | '\u{384}' | '\u{385}' | '\u{3f6}'
            | '\u{55a}'..='\u{55f}')
}

/// Combining marks of the scripts that the original lists.
fn is_mark(c: char) -> bool {
    matches!(c, '\u{300}'..='\u{36f}' | '\u{483}'..='\u{487}' | '\u{591}'..='\u{5bd}' | '\u{5bf}' | '\u{5c1}' | '\u{5c2}'
        | '\u{5c4}' | '\u{5c5}' | '\u{5c7}' | '\u{615}'..='\u{61a}' | '\u{64b}'..='\u{65e}' | '\u{670}' | '\u{6d6}'..='\u{6ed}'
        | '\u{711}' | '\u{730}'..='\u{74a}' | '\u{7a6}'..='\u{7b0}' | '\u{900}'..='\u{903}' | '\u{93c}' | '\u{93e}'..='\u{94e}'
        | '\u{951}'..='\u{955}' | '\u{962}' | '\u{963}' | '\u{981}'..='\u{983}' | '\u{9bc}' | '\u{9be}'..='\u{9cd}' | '\u{9d7}'
        | '\u{9e2}' | '\u{9e3}' | '\u{a01}'..='\u{a03}' | '\u{a3c}' | '\u{a3e}'..='\u{a4f}' | '\u{a81}'..='\u{a83}'
        | '\u{abc}' | '\u{abe}'..='\u{acd}' | '\u{b82}' | '\u{bbe}'..='\u{bcd}' | '\u{c01}'..='\u{c03}' | '\u{c3e}'..='\u{c56}'
        | '\u{d3e}'..='\u{d48}' | '\u{e31}' | '\u{e34}'..='\u{e3a}' | '\u{e47}'..='\u{e4e}' | '\u{eb1}' | '\u{eb4}'..='\u{ebc}'
        | '\u{ec8}'..='\u{ecd}')
}

/// Decimal digits of the common scripts.
fn is_digit(c: char) -> bool {
    const ZEROS: [u32; 19] = [
        0x30, 0x660, 0x6f0, 0x7c0, 0x966, 0x9e6, 0xa66, 0xae6, 0xb66, 0xbe6, 0xc66, 0xce6, 0xd66,
        0xe50, 0xed0, 0xf20, 0x1040, 0x17e0, 0xff10,
    ];
    ZEROS
        .iter()
        .any(|zero| (*zero..zero + 10).contains(&u32::from(c)))
}

/// Marks and symbols that form a token by themselves.
fn is_single_mark(c: char) -> bool {
    is_inner_mark(c)
        || matches!(
            c,
            '.' | '=' | '/' | '<' | '>' | '+' | '%' | '&' | '~' | '^' | '|' | '\\'
        )
        || matches!(c, '\u{a1}' | '\u{a6}'..='\u{a9}' | '\u{ac}' | '\u{ae}'..='\u{ba}' | '\u{bf}' | '\u{d7}' | '\u{f7}'
            | '\u{37e}' | '\u{387}' | '\u{589}' | '\u{5be}' | '\u{5c0}' | '\u{5c3}' | '\u{5c6}' | '\u{5f3}' | '\u{5f4}'
            | '\u{600}'..='\u{603}' | '\u{606}'..='\u{60a}' | '\u{60c}' | '\u{614}' | '\u{61b}' | '\u{61e}' | '\u{61f}'
            | '\u{66a}' | '\u{66d}' | '\u{6d4}' | '\u{700}'..='\u{70d}' | '\u{7f6}'..='\u{7f8}' | '\u{7fa}' | '\u{964}'
            | '\u{965}' | '\u{e4f}' | '\u{1fbd}' | '\u{2016}' | '\u{2017}' | '\u{2020}'..='\u{2023}'
            | '\u{2030}'..='\u{2038}' | '\u{203b}' | '\u{203e}'..='\u{2042}' | '\u{2044}' | '\u{207a}'..='\u{207e}'
            | '\u{208a}'..='\u{208e}' | '\u{2100}'..='\u{214f}' | '\u{2190}'..='\u{2bff}' | '\u{3002}' | '\u{3012}'
            | '\u{30fb}' | '\u{ff01}'..='\u{ff0f}' | '\u{ff1a}'..='\u{ff20}' | '\u{ff3b}'..='\u{ff40}'
            | '\u{ff5b}'..='\u{ff65}')
}
