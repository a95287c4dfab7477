//! What people mention, and how often: the table `data/mix.tsv`, computed from human sentences.

use std::collections::BTreeMap;

use crate::action::{Action, Facts, Kind};

/// The table that is part of the program; its first lines say where it comes from.
const TABLE: &str = include_str!("../../data/mix.tsv");

/// How often people mention what.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Mix {
    /// Number of sentences.
    pub sentences: usize,
    /// Number of sentences by number of stretches of time.
    pub stretches: BTreeMap<usize, usize>,
    /// Number of stretches by number of their actions.
    pub at_once: BTreeMap<usize, usize>,
    /// Number of mentions of an action, and of those that state each kind of attribute.
    pub mentions: BTreeMap<String, (usize, BTreeMap<Kind, usize>)>,
    /// Words between two stretches.
    pub links: BTreeMap<String, usize>,
    /// How sentences name the person.
    pub subjects: BTreeMap<String, usize>,
    /// Form of the first verb: `third`, `is_gerund` or `gerund`.
    pub forms: BTreeMap<String, usize>,
}

/// Links that are counted. The first that occurs between two stretches counts.
const LINKS: [&str; 9] = [
    ", and then ",
    " and then ",
    ", then ",
    " then ",
    ", followed by ",
    " before ",
    " after ",
    ". ",
    "; ",
];

impl Mix {
    /// The table of the program.
    pub fn of_people() -> Self {
        Self::parse(TABLE).unwrap_or_default()
    }

    /// Counts a sentence and what it states.
    pub fn add(&mut self, sentence: &str, facts: &Facts) {
        if facts.actions().next().is_none() {
            return;
        }
        self.sentences += 1;
        *self
            .stretches
            .entry(facts.stretches.len().min(9))
            .or_default() += 1;
        for stretch in &facts.stretches {
            *self.at_once.entry(stretch.len().min(9)).or_default() += 1;
        }
        for action in facts.actions() {
            let (n, kinds) = self.mentions.entry(action.name.to_string()).or_default();
            *n += 1;
            for (kind, _) in action.attributes() {
                *kinds.entry(kind).or_default() += 1;
            }
        }
        let text = sentence.to_lowercase();
        let mut rest = text.trim().trim_end_matches('.').to_string();
        for link in LINKS {
            let n = rest.matches(link).count();
            if n > 0 {
                *self.links.entry(link.to_string()).or_default() += n;
                rest = rest.replace(link, " | ");
            }
        }
        let words: Vec<&str> = text.split_whitespace().take(4).collect();
        let is_subject = |w: &str| {
            matches!(
                w,
                "person"
                    | "man"
                    | "someone"
                    | "somebody"
                    | "figure"
                    | "human"
                    | "subject"
                    | "individual"
                    | "character"
                    | "woman"
                    | "sim"
                    | "toon"
                    | "he"
                    | "she"
                    | "they"
                    | "guy"
                    | "user"
                    | "stickman"
            )
        };
        if let Some(at) = words.iter().position(|w| is_subject(w))
            && at < 2
        {
            *self.subjects.entry(words[..=at].join(" ")).or_default() += 1;
            let form = match words.get(at + 1..) {
                Some(["is" | "are" | "was", ..]) => "is_gerund",
                Some([verb, ..]) if verb.ends_with("ing") => "gerund",
                _ => "third",
            };
            *self.forms.entry(form.to_string()).or_default() += 1;
        }
    }

    /// Share of the mentions of an action that state a kind of attribute; that of all actions where there are fewer than
    /// thirty mentions.
    pub fn share(&self, action: &Action, kind: Kind) -> f64 {
        let own = self.mentions.get(action.name).filter(|(n, _)| *n >= 30);
        let (n, stated) = match own {
            Some((n, kinds)) => (*n, kinds.get(&kind).copied().unwrap_or_default()),
            None => self.mentions.values().fold((0, 0), |(n, k), (m, kinds)| {
                (n + m, k + kinds.get(&kind).copied().unwrap_or_default())
            }),
        };
        stated as f64 / n.max(1) as f64
    }

    /// The table as text, with tabs between its columns.
    pub fn table(&self) -> String {
        let mut out = format!("sentences\tall\t{}\n", self.sentences);
        let mut put = |kind: &str, key: &str, n: usize| {
            out.push_str(&format!("{kind}\t{key}\t{n}\n"));
        };
        self.stretches
            .iter()
            .for_each(|(k, n)| put("stretches", &k.to_string(), *n));
        self.at_once
            .iter()
            .for_each(|(k, n)| put("at_once", &k.to_string(), *n));
        self.links.iter().for_each(|(k, n)| put("link", k, *n));
        let named = self.subjects.iter().filter(|(_, n)| **n >= 10);
        named.for_each(|(k, n)| put("subject", k, *n));
        self.forms.iter().for_each(|(k, n)| put("form", k, *n));
        for (name, (n, kinds)) in &self.mentions {
            put("action", name, *n);
            for (kind, n) in kinds {
                put(name, kind.name(), *n);
            }
        }
        out
    }

    /// Reads [`Mix::table`]; lines that begin with `#` are comments. `None` if a line is no row.
    pub fn parse(table: &str) -> Option<Self> {
        let mut mix = Self::default();
        for line in table.lines().filter(|l| !l.starts_with('#')) {
            let mut columns = line.split('\t');
            let (kind, key) = (columns.next()?, columns.next()?);
            let n: usize = columns.next()?.parse().ok()?;
            match kind {
                "sentences" => mix.sentences = n,
                "stretches" => {
                    mix.stretches.insert(key.parse().ok()?, n);
                }
                "at_once" => {
                    mix.at_once.insert(key.parse().ok()?, n);
                }
                "link" => {
                    mix.links.insert(key.to_string(), n);
                }
                "subject" => {
                    mix.subjects.insert(key.to_string(), n);
                }
                "form" => {
                    mix.forms.insert(key.to_string(), n);
                }
                "action" => mix.mentions.entry(key.to_string()).or_default().0 = n,
                action => {
                    let kind = Kind::ALL.into_iter().find(|k| k.name() == key)?;
                    mix.mentions.get_mut(action)?.1.insert(kind, n);
                }
            }
        }
        Some(mix)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_comes_back() {
        let mut mix = Mix::default();
        for sentence in [
            "a person walks forward, then waves",
            "someone is jumping twice",
        ] {
            mix.add(sentence, &crate::facts(sentence));
        }
        assert_eq!(mix.sentences, 2);
        assert_eq!(mix.links[", then "], 1);
        assert_eq!(mix.forms["is_gerund"], 1);
        assert_eq!(
            mix.share(&Action::named("walk"), Kind::Direction),
            1.0 / 3.0
        );
        let mut back = Mix::parse(&format!("# comment\n{}", mix.table())).unwrap();
        // Rare subjects are left out of the table.
        back.subjects = mix.subjects.clone();
        assert_eq!(back, mix);
    }

    #[test]
    fn the_table_of_people_is_one() {
        let mix = Mix::parse(TABLE).unwrap();
        assert!(mix.sentences > 40_000, "{}", mix.sentences);
        assert!(mix.share(&Action::named("walk"), Kind::Direction) > 0.2);
        assert!(Mix::parse("walk\tside\t3").is_none());
    }
}
