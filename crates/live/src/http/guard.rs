//! Who may ask.
//!
//! A page of another site can make a browser ask this server. Three checks keep it out: the name under which the server
//! is asked (against DNS that points a foreign name here), the origin of the asking page, and the token.

use std::net::{IpAddr, SocketAddr};

use axum::http::header::{
    AUTHORIZATION, CACHE_CONTROL, CONTENT_SECURITY_POLICY, COOKIE, HOST, HeaderName, HeaderValue,
    ORIGIN, REFERRER_POLICY, SET_COOKIE, WWW_AUTHENTICATE, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::request::Parts;
use axum::http::{HeaderMap, StatusCode};

use super::answer::{Answer, Refused};
use super::{HttpError, Options, Token};

/// Name of the cookie with the token.
const COOKIE_NAME: &str = "radarllm_token";
/// How long a browser keeps the cookie, s: a year, for tablets on a wall.
const COOKIE_S: u32 = 31_536_000;
/// What a browser tells of the relation between the asking page and this server.
const SEC_FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");
const CROSS_ORIGIN_RESOURCE_POLICY: HeaderName =
    HeaderName::from_static("cross-origin-resource-policy");

/// The checks and the headers of one server.
#[derive(Debug)]
pub(super) struct Guard {
    address: SocketAddr,
    names: Vec<String>,
    token: Option<Token>,
    policy: HeaderValue,
}

/// A request that may be answered.
#[derive(Debug)]
pub(super) struct Admitted {
    /// The cookie that the answer sets.
    cookie: Option<HeaderValue>,
}

impl Guard {
    pub(super) fn new(options: &Options, address: SocketAddr) -> Result<Self, HttpError> {
        for name in &options.allow_hosts {
            check(name, "name of a host such as radar.local", is_host_name)?;
        }
        for origin in &options.allow_frames {
            let expected = "origin such as http://homeassistant.local:8123";
            check(origin, expected, is_origin)?;
        }
        let frames = match options.allow_frames.is_empty() {
            true => "'none'".to_string(),
            false => options.allow_frames.join(" "),
        };
        let policy = format!(
            "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
             base-uri 'none'; form-action 'none'; frame-ancestors {frames}"
        );
        Ok(Self {
            address,
            names: options
                .allow_hosts
                .iter()
                .map(|name| name.to_ascii_lowercase())
                .collect(),
            token: options.token.clone(),
            policy: HeaderValue::try_from(policy).map_err(|_| HttpError::Name {
                expected: "list of origins",
                found: frames,
            })?,
        })
    }

    /// Checks the head of a request.
    pub(super) fn admit(&self, request: &Parts) -> Result<Admitted, Refused> {
        let host = self.host(request)?;
        self.check_origin(request, &host)?;
        self.check_token(request)
    }

    /// Adds the headers that every answer has.
    pub(super) fn seal(&self, admitted: Option<&Admitted>, answer: &mut Answer) {
        let is_unauthorized = answer.status() == StatusCode::UNAUTHORIZED;
        let headers = answer.headers_mut();
        headers.insert(CONTENT_SECURITY_POLICY, self.policy.clone());
        for (name, value) in [
            (X_CONTENT_TYPE_OPTIONS, "nosniff"),
            (REFERRER_POLICY, "no-referrer"),
            (CACHE_CONTROL, "no-store"),
            (CROSS_ORIGIN_RESOURCE_POLICY, "same-origin"),
        ] {
            headers.insert(name, HeaderValue::from_static(value));
        }
        if is_unauthorized {
            headers.insert(WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        if let Some(cookie) = admitted.and_then(|a| a.cookie.clone()) {
            headers.insert(SET_COOKIE, cookie);
        }
    }

    /// The name under which the server is asked, in lower case.
    fn host(&self, request: &Parts) -> Result<String, Refused> {
        let bad = |why| Refused::new(StatusCode::BAD_REQUEST, why);
        let mut hosts = request.headers.get_all(HOST).iter();
        let host = hosts
            .next()
            .ok_or_else(|| bad("the request has no Host header"))?;
        if hosts.next().is_some() {
            return Err(bad("the request has several Host headers"));
        }
        let host = host.to_str().unwrap_or_default().to_ascii_lowercase();
        let target = request.uri.authority().map(|a| a.as_str());
        let is_target = target.is_none_or(|target| target.eq_ignore_ascii_case(&host));
        match is_target && self.is_ours(&host) {
            true => Ok(host),
            false => Err(Refused::new(
                StatusCode::MISDIRECTED_REQUEST,
                "this server is not known under that name; open it by its IP address, or start it with the option --allow-host NAME",
            )),
        }
    }

    fn is_ours(&self, host: &str) -> bool {
        let (name, port) = split_port(host);
        if self.names.iter().any(|n| n == name) {
            return true;
        }
        let is_our_port = port.unwrap_or("80") == self.address.port().to_string();
        let literal = name
            .strip_prefix('[')
            .and_then(|n| n.strip_suffix(']'))
            .unwrap_or(name);
        let own = self.address.ip();
        match literal.parse::<IpAddr>() {
            // No name, which DNS could point here. Others than this computer reach it under addresses and ports that only
            // their network knows.
            Ok(ip) if !own.is_loopback() => !ip.is_unspecified(),
            Ok(ip) => is_our_port && ip.is_loopback(),
            Err(_) => is_our_port && name == "localhost",
        }
    }

    /// Refuses requests that the page of another origin makes.
    fn check_origin(&self, request: &Parts, host: &str) -> Result<(), Refused> {
        let foreign = || {
            Refused::new(
                StatusCode::FORBIDDEN,
                "pages of other origins may not ask this server",
            )
        };
        for origin in request.headers.get_all(ORIGIN) {
            let origin = origin.to_str().unwrap_or_default().to_ascii_lowercase();
            let rest = origin
                .strip_prefix("http://")
                .or_else(|| origin.strip_prefix("https://"));
            if rest != Some(host) {
                return Err(foreign());
            }
        }
        // Not every request of a foreign page has an origin; links to the page itself may come from anywhere.
        let site = request.headers.get(SEC_FETCH_SITE);
        let is_foreign = site.is_some_and(|s| s == "cross-site" || s == "same-site");
        match is_foreign && request.uri.path() != "/" {
            true => Err(foreign()),
            false => Ok(()),
        }
    }

    fn check_token(&self, request: &Parts) -> Result<Admitted, Refused> {
        let Some(token) = &self.token else {
            return Ok(Admitted { cookie: None });
        };
        if is_bearer(&request.headers, token) || has_cookie(&request.headers, token) {
            return Ok(Admitted { cookie: None });
        }
        let query = request.uri.query().unwrap_or_default();
        let mut asked = query.split('&').filter_map(|p| p.strip_prefix("token="));
        if request.uri.path() == "/" && asked.any(|t| token.is(t)) {
            let cookie = format!(
                "{COOKIE_NAME}={}; HttpOnly; SameSite=Strict; Path=/; Max-Age={COOKIE_S}",
                token.reveal()
            );
            return Ok(Admitted {
                cookie: HeaderValue::try_from(cookie).ok(),
            });
        }
        Err(Refused::new(
            StatusCode::UNAUTHORIZED,
            "a token is needed: open /?token=TOKEN, or send `Authorization: Bearer TOKEN`",
        ))
    }
}

fn is_bearer(headers: &HeaderMap, token: &Token) -> bool {
    let value = headers.get(AUTHORIZATION).and_then(|v| v.to_str().ok());
    let Some((scheme, sent)) = value.and_then(|v| v.split_once(' ')) else {
        return false;
    };
    scheme.eq_ignore_ascii_case("bearer") && token.is(sent.trim())
}

fn has_cookie(headers: &HeaderMap, token: &Token) -> bool {
    headers
        .get_all(COOKIE)
        .iter()
        .filter_map(|v| v.to_str().ok())
        .flat_map(|v| v.split(';'))
        .filter_map(|pair| pair.trim().split_once('='))
        .any(|(name, value)| name == COOKIE_NAME && token.is(value))
}

/// The name and the port of a `Host` header. An IPv6 address stands in brackets.
fn split_port(host: &str) -> (&str, Option<&str>) {
    match host.rsplit_once(':') {
        Some((name, port)) if !port.ends_with(']') => (name, Some(port)),
        _ => (host, None),
    }
}

fn check(
    text: &str,
    expected: &'static str,
    is_it: impl Fn(&str) -> bool,
) -> Result<(), HttpError> {
    match is_it(text) {
        true => Ok(()),
        false => Err(HttpError::Name {
            expected,
            found: text.into(),
        }),
    }
}

/// Letters, digits, `.` and `-`, or an IPv6 address in brackets; no port.
fn is_host_name(text: &str) -> bool {
    let is_name = |t: &str| {
        !t.is_empty()
            && t.bytes()
                .all(|b| b.is_ascii_alphanumeric() || b".-_".contains(&b))
    };
    let address = text.strip_prefix('[').and_then(|t| t.strip_suffix(']'));
    match address {
        Some(address) => address.parse::<std::net::Ipv6Addr>().is_ok(),
        None => is_name(text),
    }
}

/// `http://HOST`, `https://HOST` or either with a port.
fn is_origin(text: &str) -> bool {
    let rest = text
        .strip_prefix("http://")
        .or_else(|| text.strip_prefix("https://"));
    rest.is_some_and(|rest| {
        let (name, port) = split_port(rest);
        is_host_name(name) && port.is_none_or(|p| p.parse::<u16>().is_ok())
    })
}
