//! Checked parameter values of one motion.

use std::collections::BTreeMap;
use std::fmt;

use crate::error::BuiltinError;
use crate::spec::{GLOBAL_KEYS, KeyKind, KeySpec, MotionSpec};

/// A checked value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// A finite number within the key's range.
    Number(f32),
    /// A whole number within the key's range.
    Count(u32),
    /// One of the key's words.
    Word(&'static str),
}

/// Parameter values given for some keys; all other keys have their defaults.
#[derive(Clone, Debug, PartialEq)]
pub struct Values {
    keys: &'static [KeySpec],
    set: BTreeMap<&'static str, Value>,
}

impl Values {
    /// Creates values for a motion with all keys at their defaults.
    pub fn of(spec: &'static MotionSpec) -> Self {
        Self {
            keys: spec.keys,
            set: BTreeMap::new(),
        }
    }

    /// Creates values for the global keys, all at their defaults.
    pub fn global() -> Self {
        Self {
            keys: GLOBAL_KEYS,
            set: BTreeMap::new(),
        }
    }

    /// Returns true if this set has the key.
    pub fn knows(&self, name: &str) -> bool {
        self.kind(name).is_some()
    }

    /// Checks and stores `text` under the key.
    ///
    /// # Errors
    /// [`BuiltinError::Value`], with the accepted values, if the key does not accept the text.
    pub fn set(&mut self, name: &str, text: &str) -> Result<(), BuiltinError> {
        let Some(key) = self.keys.iter().find(|k| k.name == name) else {
            return Err(BuiltinError::Key {
                key: name.to_owned(),
                motion: "this motion".to_owned(),
                allowed: self
                    .keys
                    .iter()
                    .map(|k| k.name)
                    .collect::<Vec<_>>()
                    .join(", "),
            });
        };
        let refuse = || BuiltinError::Value {
            key: key.name,
            value: text.chars().take(40).collect(),
            allowed: key.kind.describe(),
        };
        let number = |min: f32, max: f32| {
            text.parse::<f32>()
                .ok()
                .filter(|x| x.is_finite() && (min..=max).contains(x))
                .map(Value::Number)
        };
        let value = match key.kind {
            KeyKind::Word { allowed, .. } => {
                allowed.iter().find(|w| **w == text).map(|w| Value::Word(w))
            }
            KeyKind::Number { min, max, .. } | KeyKind::Optional { min, max } => number(min, max),
            KeyKind::Count { max, .. } => text
                .parse::<u32>()
                .ok()
                .filter(|n| (1..=max).contains(n))
                .map(Value::Count),
            KeyKind::Speed => match text {
                "slow" => Some(Value::Number(0.7)),
                "normal" => Some(Value::Number(1.0)),
                "fast" => Some(Value::Number(1.45)),
                _ => number(0.4, 2.0),
            },
        };
        self.set.insert(key.name, value.ok_or_else(refuse)?);
        Ok(())
    }

    /// Removes the value of a key.
    pub fn forget(&mut self, name: &str) {
        self.set.remove(name);
    }

    /// Returns the number of a key: the default if the key is not given, 0 if there is no such key.
    pub fn number(&self, name: &str) -> f32 {
        match (self.set.get(name), self.kind(name)) {
            (Some(Value::Number(x)), _) => *x,
            (_, Some(KeyKind::Number { default, .. })) => default,
            (_, Some(KeyKind::Speed)) => 1.0,
            _ => 0.0,
        }
    }

    /// Returns the number of a key if it was given.
    pub fn given(&self, name: &str) -> Option<f32> {
        match self.set.get(name) {
            Some(Value::Number(x)) => Some(*x),
            _ => None,
        }
    }

    /// Returns true if the key was given.
    pub fn is_set(&self, name: &str) -> bool {
        self.set.contains_key(name)
    }

    /// Returns the count of a key: the default if the key is not given, 1 if there is no such key.
    pub fn count(&self, name: &str) -> u32 {
        match (self.set.get(name), self.kind(name)) {
            (Some(Value::Count(n)), _) => *n,
            (_, Some(KeyKind::Count { default, .. })) => default,
            _ => 1,
        }
    }

    /// Returns the word of a key: the default if the key is not given, empty if there is no such
    /// key.
    pub fn word(&self, name: &str) -> &'static str {
        match (self.set.get(name), self.kind(name)) {
            (Some(Value::Word(w)), _) => w,
            (_, Some(KeyKind::Word { default, .. })) => default,
            _ => "",
        }
    }

    /// Speed multiplier; 1 if the motion has no such key.
    pub fn speed(&self) -> f32 {
        if self.knows("speed") {
            self.number("speed")
        } else {
            1.0
        }
    }

    /// Amplitude multiplier; 1 if the motion has no such key.
    pub fn amplitude(&self) -> f32 {
        if self.knows("amplitude") {
            self.number("amplitude")
        } else {
            1.0
        }
    }

    /// Sides (0 left, 1 right) selected by the key `side`.
    pub fn sides(&self) -> &'static [usize] {
        match self.word("side") {
            "left" => &[0],
            "right" => &[1],
            _ => &[0, 1],
        }
    }

    /// The given keys with their values in request syntax.
    pub fn written(&self) -> impl Iterator<Item = (&'static str, Value)> + '_ {
        self.set.iter().map(|(k, v)| (*k, *v))
    }

    fn kind(&self, name: &str) -> Option<KeyKind> {
        self.keys.iter().find(|k| k.name == name).map(|k| k.kind)
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Value::Number(x) => write!(f, "{x}"),
            Value::Count(n) => write!(f, "{n}"),
            Value::Word(w) => f.write_str(w),
        }
    }
}
