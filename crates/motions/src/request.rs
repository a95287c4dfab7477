//! Parsing, checking and formatting of requests such as
//! `builtin:walk+then+sit_down?walk.speed=slow&side=left`.

use std::fmt;

use crate::error::BuiltinError;
use crate::motions;
use crate::spec::{GLOBAL_KEYS, MotionSpec, Posture, spec, specs};
use crate::values::{Value, Values};

/// Optional prefix of every request.
pub const PREFIX: &str = "builtin:";
/// Maximum length of a request, bytes.
const MAX_BYTES: usize = 2000;
/// Maximum number of motions in a request.
const MAX_PARTS: usize = 8;

/// One motion with its parameter values.
#[derive(Clone, Debug)]
pub struct Part {
    /// Specification of the motion.
    pub spec: &'static MotionSpec,
    /// Its checked values.
    pub values: Values,
}

/// A motion with an optional gesture on the upper body.
#[derive(Clone, Debug)]
pub struct Segment {
    /// Motion of the legs and trunk, and of the arms if there is no gesture.
    pub base: Part,
    /// Gesture given after `+while+`.
    pub overlay: Option<Part>,
}

/// A checked request that can be rendered with any seed.
#[derive(Clone, Debug)]
pub struct BuiltinRequest {
    /// Motions in sequence; at least one.
    pub segments: Vec<Segment>,
    /// Values of [`GLOBAL_KEYS`].
    pub global: Values,
}

/// Parses a request; the prefix `builtin:` is optional.
///
/// A plain key applies to every part that has this key. A key with the prefix `name.` applies only
/// to the parts with that name.
///
/// # Errors
/// [`BuiltinError`], which lists the accepted alternatives.
pub fn parse(text: &str) -> Result<BuiltinRequest, BuiltinError> {
    if text.len() > MAX_BYTES {
        return Err(BuiltinError::TooLong {
            length: text.len(),
            limit: MAX_BYTES,
        });
    }
    let text = text.strip_prefix(PREFIX).unwrap_or(text);
    let (chain, query) = match text.split_once('?') {
        Some((chain, query)) => (chain, query),
        None => (text, ""),
    };
    let mut segments = parse_chain(chain)?;
    let mut global = Values::global();
    for pair in query.split('&').filter(|p| !p.is_empty()) {
        let Some((key, value)) = pair.split_once('=') else {
            return Err(BuiltinError::Pair {
                text: shorten(pair),
            });
        };
        apply(&mut segments, &mut global, key, value)?;
    }
    let mut request = BuiltinRequest { segments, global };
    request.settle_seams()?;
    let height_m = request.global.number("height_m");
    for part in request.parts() {
        motions::check(part.spec.name, &part.values, height_m)?;
    }
    Ok(request)
}

impl BuiltinRequest {
    /// All parts in the order in which they are written.
    pub fn parts(&self) -> impl Iterator<Item = &Part> {
        self.segments
            .iter()
            .flat_map(|s| std::iter::once(&s.base).chain(s.overlay.as_ref()))
    }

    /// Checks that every motion can follow the preceding one, and sets the initial posture of
    /// `stand_up`.
    fn settle_seams(&mut self) -> Result<(), BuiltinError> {
        let mut before: Option<(&'static str, Posture)> = None;
        for segment in &mut self.segments {
            let part = &mut segment.base;
            if let Some((name, ends)) = before {
                if part.spec.name == "stand_up"
                    && !part.values.is_set("from")
                    && ends == Posture::Lying
                {
                    part.values.set("from", "floor")?;
                }
                let starts = match (part.spec.starts, part.values.word("from")) {
                    (Posture::SeatedOrLying, "floor") => Posture::Lying,
                    (Posture::SeatedOrLying, _) => Posture::Seated,
                    (starts, _) => starts,
                };
                if starts != ends {
                    let help = match (ends, starts) {
                        (Posture::Seated | Posture::Lying, Posture::Standing) => {
                            "; put `stand_up` between them"
                        }
                        (Posture::Standing, Posture::Seated) => "; put `sit_down` between them",
                        (Posture::Standing, Posture::Lying) => "; put `lie_down` between them",
                        (Posture::Fallen, _) => "; nothing can follow",
                        _ => "",
                    };
                    return Err(BuiltinError::Seam {
                        before: name,
                        ends: posture_name(ends),
                        next: part.spec.name,
                        starts: posture_name(starts),
                        help,
                    });
                }
            }
            before = Some((part.spec.name, part.spec.ends(&part.values)));
        }
        Ok(())
    }
}

impl fmt::Display for BuiltinRequest {
    /// Writes the canonical form, which [`parse`] converts back into the same request.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(PREFIX)?;
        for (n, segment) in self.segments.iter().enumerate() {
            if n > 0 {
                f.write_str("+then+")?;
            }
            f.write_str(segment.base.spec.name)?;
            if let Some(overlay) = &segment.overlay {
                write!(f, "+while+{}", overlay.spec.name)?;
            }
        }
        let alone = self.parts().count() == 1;
        let mut pairs: Vec<String> = Vec::new();
        for part in self.parts() {
            for (key, value) in part.values.written() {
                let pair = if alone {
                    format!("{key}={value}")
                } else {
                    format!("{}.{key}={value}", part.spec.name)
                };
                if !pairs.contains(&pair) {
                    pairs.push(pair);
                }
            }
        }
        pairs.extend(
            self.global
                .written()
                .map(|(k, v): (_, Value)| format!("{k}={v}")),
        );
        if !pairs.is_empty() {
            write!(f, "?{}", pairs.join("&"))?;
        }
        Ok(())
    }
}

fn parse_chain(chain: &str) -> Result<Vec<Segment>, BuiltinError> {
    if chain.is_empty() {
        return Err(BuiltinError::Empty);
    }
    let bad = || BuiltinError::Chain {
        text: shorten(chain),
        limit: MAX_PARTS,
    };
    let words: Vec<&str> = chain.split('+').collect();
    if words.len().is_multiple_of(2) || words.len() > 2 * MAX_PARTS - 1 {
        return Err(bad());
    }
    let mut segments = vec![Segment {
        base: part(words[0])?,
        overlay: None,
    }];
    for pair in words[1..].chunks_exact(2) {
        let next = part(pair[1])?;
        match (pair[0], segments.last_mut()) {
            ("then", _) => segments.push(Segment {
                base: next,
                overlay: None,
            }),
            ("while", Some(segment)) if segment.overlay.is_none() => {
                let refuse = |name, place, allowed: fn(&MotionSpec) -> bool| {
                    let allowed: Vec<&str> = specs()
                        .iter()
                        .filter(|s| allowed(s))
                        .map(|s| s.name)
                        .collect();
                    Err(BuiltinError::Overlay {
                        name,
                        place,
                        allowed: allowed.join(", "),
                    })
                };
                if !segment.base.spec.carries {
                    return refuse(segment.base.spec.name, "before", |s| s.carries);
                }
                if !next.spec.overlays {
                    return refuse(next.spec.name, "after", |s| s.overlays);
                }
                segment.overlay = Some(next);
            }
            _ => return Err(bad()),
        }
    }
    Ok(segments)
}

fn part(name: &str) -> Result<Part, BuiltinError> {
    let spec = spec(name).ok_or_else(|| BuiltinError::Motion {
        name: shorten(name),
        allowed: specs()
            .iter()
            .map(|s| s.name)
            .collect::<Vec<_>>()
            .join(", "),
    })?;
    Ok(Part {
        spec,
        values: Values::of(spec),
    })
}

fn apply(
    segments: &mut [Segment],
    global: &mut Values,
    key: &str,
    value: &str,
) -> Result<(), BuiltinError> {
    let twice = || BuiltinError::Twice { key: shorten(key) };
    if global.knows(key) {
        if global.is_set(key) {
            return Err(twice());
        }
        return global.set(key, value);
    }
    let (only, name) = match key.split_once('.') {
        Some((only, name)) => (Some(only), name),
        None => (None, key),
    };
    let mut known = false;
    let mut asked = Vec::new();
    let parts = segments
        .iter_mut()
        .flat_map(|s| std::iter::once(&mut s.base).chain(s.overlay.as_mut()));
    for part in parts {
        if only.is_some_and(|only| only != part.spec.name) {
            continue;
        }
        asked.push((part.spec.name, part.spec.keys));
        if part.values.knows(name) {
            known = true;
            if part.values.is_set(name) {
                return Err(twice());
            }
            part.values.set(name, value)?;
        }
    }
    if known {
        return Ok(());
    }
    let mut allowed: Vec<&str> = asked
        .iter()
        .flat_map(|(_, keys)| keys.iter().map(|k| k.name))
        .collect();
    if only.is_none() || asked.is_empty() {
        allowed.extend(GLOBAL_KEYS.iter().map(|k| k.name));
    }
    allowed.sort_unstable();
    allowed.dedup();
    let mut names: Vec<&str> = asked.iter().map(|(name, _)| *name).collect();
    names.dedup();
    let motion = if names.is_empty() {
        shorten(only.unwrap_or(""))
    } else {
        names.join("`, `")
    };
    Err(BuiltinError::Key {
        key: shorten(name),
        motion,
        allowed: allowed.join(", "),
    })
}

fn posture_name(posture: Posture) -> &'static str {
    match posture {
        Posture::Standing => "standing",
        Posture::Seated => "seated",
        Posture::Lying => "lying on the back",
        Posture::Fallen => "fallen",
        Posture::SeatedOrLying => "seated or lying",
    }
}

fn shorten(text: &str) -> String {
    text.chars().take(40).collect()
}
