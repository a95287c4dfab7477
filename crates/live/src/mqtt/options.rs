//! Where messages are published, as whom, and which.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use super::MqttError;

/// Port of brokers without TLS.
const PORT: u16 = 1_883;
/// Longest host name, bytes.
const MAX_HOST: usize = 253;
/// Longest user name, password and prefix, bytes.
const MAX_TEXT: usize = 256;
/// Longest name of a radar, bytes.
const MAX_NAME: usize = 32;

/// Address of a broker.
///
/// ```
/// let address: radarllm_live::mqtt::Address = "mqtt://homeassistant.local".parse()?;
/// assert_eq!((&address.host[..], address.port), ("homeassistant.local", 1883));
/// # Ok::<(), radarllm_live::mqtt::MqttError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// Name or IP address, without brackets.
    pub host: String,
    /// TCP port.
    pub port: u16,
}

impl Address {
    fn validate(&self) -> Result<(), MqttError> {
        let is_safe = |b: u8| b.is_ascii_alphanumeric() || b"-._:%".contains(&b);
        match self.port != 0
            && (1..=MAX_HOST).contains(&self.host.len())
            && self.host.bytes().all(is_safe)
        {
            true => Ok(()),
            false => Err(MqttError::Address {
                found: format!("{}:{}", self.host, self.port),
                hint: "",
            }),
        }
    }
}

impl FromStr for Address {
    type Err = MqttError;

    /// Reads `mqtt://HOST[:PORT]`; the scheme may be missing, and an IPv6 address stands in brackets.
    fn from_str(text: &str) -> Result<Self, MqttError> {
        let error = |hint| MqttError::Address {
            found: text.into(),
            hint,
        };
        let rest = match text.split_once("://") {
            None | Some(("mqtt", _)) => text.strip_prefix("mqtt://").unwrap_or(text),
            Some(("mqtts" | "ssl", _)) => return Err(error("; TLS is not supported")),
            Some(_) => return Err(error("")),
        };
        if rest.contains('@') {
            // The text may hold a password, so that it is not repeated.
            return Err(MqttError::Address {
                found: "USER@HOST".into(),
                hint: "; user and password are options of their own",
            });
        }
        let rest = rest.strip_suffix('/').unwrap_or(rest);
        let (host, port) = match rest.strip_prefix('[') {
            Some(inner) => {
                let (host, after) = inner.split_once(']').ok_or_else(|| error(""))?;
                match after {
                    "" => (host, None),
                    // Without a colon it is no number and refused below.
                    _ => (host, Some(after.strip_prefix(':').unwrap_or("x"))),
                }
            }
            None => match rest.split_once(':') {
                Some((host, port)) => (host, Some(port)),
                None => (rest, None),
            },
        };
        let port = match port {
            Some(port) => port.parse().map_err(|_| error(""))?,
            None => PORT,
        };
        let address = Self {
            host: host.into(),
            port,
        };
        match address.validate() {
            Ok(()) => Ok(address),
            Err(_) => Err(error("")),
        }
    }
}

/// A password. It is never printed.
#[derive(Clone, PartialEq, Eq)]
pub struct Password(String);

impl Password {
    /// A password from the text of a file; line ends after it are ignored.
    pub fn new(text: &str) -> Self {
        Self(text.trim_end_matches(['\r', '\n']).into())
    }

    /// The password, for the broker.
    pub(super) fn reveal(&self) -> &str {
        &self.0
    }
}

impl fmt::Debug for Password {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Password(..)")
    }
}

/// Where messages are published, as whom, and which.
#[derive(Clone, Debug)]
pub struct Options {
    /// The broker.
    pub address: Address,
    /// User name.
    pub user: Option<String>,
    /// Password of the user.
    pub password: Option<Password>,
    /// First part of the topics of Home Assistant.
    pub discovery_prefix: String,
    /// Actions of the model. Labels that are none of them are published as `other`.
    pub actions: Vec<String>,
    /// Whether messages of a simulated radar are published.
    pub allow_synthetic: bool,
    /// First and longest time between two attempts to connect, 1 ms to an hour.
    pub retry: [Duration; 2],
    /// Transitions of falls that are older when a connection begins are not sent.
    pub max_fall_age: Duration,
}

impl Options {
    /// The options for a broker: no user, the prefix `homeassistant`, no actions, no simulated messages.
    pub fn new(address: Address) -> Self {
        Self {
            address,
            user: None,
            password: None,
            discovery_prefix: "homeassistant".into(),
            actions: Vec::new(),
            allow_synthetic: false,
            retry: [Duration::from_millis(500), Duration::from_secs(30)],
            max_fall_age: Duration::from_secs(60),
        }
    }

    /// Checks what does not depend on the radar.
    pub(super) fn validate(&self) -> Result<(), MqttError> {
        self.address.validate()?;
        let is_plain = |text: &str| !text.chars().any(char::is_control);
        let prefix = &self.discovery_prefix;
        let is_topic = (1..=MAX_TEXT).contains(&prefix.len())
            && is_plain(prefix)
            && !prefix.contains(['+', '#', '$'])
            && prefix.split('/').all(|level| !level.is_empty());
        if !is_topic {
            return Err(MqttError::Name {
                what: "prefix of topics",
                found: prefix.clone(),
                expected: "levels between slashes, without + # $, for example homeassistant",
            });
        }
        let login = |found| {
            Err(MqttError::Login {
                found,
                expected: "a user name, and a password if need be, of 1 to 256 bytes each",
            })
        };
        let is_length = |text: &str| (1..=MAX_TEXT).contains(&text.len());
        match (&self.user, &self.password) {
            (None, Some(_)) => login("there is a password and no user name"),
            (Some(user), _) if !is_length(user) || !is_plain(user) => {
                login("the user name is empty, too long or has control characters")
            }
            (_, Some(password)) if !is_length(password.reveal()) => {
                login("the password is empty or too long")
            }
            _ => Ok(()),
        }
    }
}

/// Checks the name of a radar, which is part of topics and of the numbers of entities.
///
/// # Errors
/// [`MqttError::Name`].
pub fn validate_name(name: &str) -> Result<(), MqttError> {
    let is_safe = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_';
    match (1..=MAX_NAME).contains(&name.len()) && name.bytes().all(is_safe) {
        true => Ok(()),
        false => Err(MqttError::Name {
            what: "name of a radar",
            found: name.chars().take(2 * MAX_NAME).collect(),
            expected: "1 to 32 small letters a to z, digits and underscores, for example lounge",
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_and_others_refused() {
        for (text, host, port) in [
            ("mqtt://broker.lan", "broker.lan", 1883),
            ("mqtt://broker.lan:2883/", "broker.lan", 2883),
            ("192.168.1.4", "192.168.1.4", 1883),
            ("mqtt://[fe80::1%eth0]:99", "fe80::1%eth0", 99),
            ("[::1]", "::1", 1883),
        ] {
            let address: Address = text.parse().unwrap();
            assert_eq!((&address.host[..], address.port), (host, port), "{text}");
        }
        for text in [
            "",
            "mqtt://",
            "mqtt://:1883",
            "mqtt://a:b",
            "mqtt://a:0",
            "mqtt://a:65536",
            "mqtt://a b",
            "mqtt://a/b",
            "mqtts://a",
            "http://a",
            "[::1",
            "[::1]x",
            "::1",
            "mqtt://user:secret@a",
        ] {
            let error = text.parse::<Address>().unwrap_err().to_string();
            assert!(!error.contains("secret"), "{error}");
        }
        let error = "mqtts://a".parse::<Address>().unwrap_err().to_string();
        assert!(error.contains("TLS"), "{error}");
    }

    #[test]
    fn names_have_small_letters_digits_and_underscores() {
        for name in ["a", "lounge", "bed_room_2", &"a".repeat(32)] {
            validate_name(name).unwrap();
        }
        for name in [
            "",
            "Lounge",
            "a b",
            "a/b",
            "a+",
            "#",
            "küche",
            "a-b",
            "a\0",
            &"a".repeat(33),
        ] {
            assert!(validate_name(name).is_err(), "{name}");
        }
    }

    #[test]
    fn options_are_checked_and_never_print_the_password() {
        let plain = Options::new("broker".parse().unwrap());
        plain.validate().unwrap();
        let with = |change: fn(&mut Options)| {
            let mut options = plain.clone();
            change(&mut options);
            options
        };
        let good = with(|o| {
            o.user = Some("radar".into());
            o.password = Some(Password::new("pass word\r\n"));
        });
        good.validate().unwrap();
        assert_eq!(good.password.as_ref().unwrap().reveal(), "pass word");
        assert!(!format!("{good:?}").contains("pass word"), "{good:?}");
        for bad in [
            with(|o| o.password = Some(Password::new("secret"))),
            with(|o| o.user = Some(String::new())),
            with(|o| o.user = Some("a\nb".into())),
            with(|o| {
                o.user = Some("radar".into());
                o.password = Some(Password::new(&"secret".repeat(100)));
            }),
            with(|o| o.discovery_prefix = String::new()),
            with(|o| o.discovery_prefix = "a/#".into()),
            with(|o| o.discovery_prefix = "a//b".into()),
            with(|o| o.discovery_prefix = "/a".into()),
            with(|o| o.discovery_prefix = "$SYS".into()),
            with(|o| o.address.host = "a b".into()),
            with(|o| o.address.port = 0),
        ] {
            let error = bad.validate().unwrap_err().to_string();
            assert!(!error.contains("secret"), "{error}");
        }
    }
}
