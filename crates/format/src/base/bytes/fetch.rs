//! A range request, with retries.

use std::io::{Error as IoError, ErrorKind as Kind, Read};
use std::ops::Range;
use std::sync::LazyLock;
use std::time::Duration;

use ureq::Agent;
use ureq::http::{HeaderMap, Response, StatusCode};
use ureq::tls::{RootCerts, TlsConfig};

use super::address::shown;
use crate::base::error::{Error, Result};

/// Requests for one range, at most.
const TRIES: u32 = 4;
/// Delay before the second try; each later one is four times as long.
const PAUSE: Duration = Duration::from_millis(200);
/// Timeouts for a connection and for data.
const PATIENCE: Duration = Duration::from_secs(30);
/// A server without support for ranges sends whole files. Longer ones are refused.
const LARGEST_WHOLE: u64 = 256 << 20;

static AGENT: LazyLock<Agent> = LazyLock::new(|| {
    let tls = TlsConfig::builder().root_certs(RootCerts::PlatformVerifier).build();
    let config = Agent::config_builder()
        .http_status_as_error(false)
        .timeout_connect(Some(PATIENCE))
        .timeout_recv_response(Some(PATIENCE))
        .timeout_recv_body(Some(10 * PATIENCE))
        .user_agent(concat!("mipvog-bake/", env!("CARGO_PKG_VERSION")))
        .tls_config(tls);
    config.build().into()
});

/// Bytes of a file, and the server's facts about it.
pub struct Answer {
    /// The offset of the first byte.
    pub start: u64,
    pub bytes: Vec<u8>,
    /// Bytes of the whole file.
    pub length: u64,
    /// The server's name of this version of the file.
    pub version: Option<String>,
}

/// A failed request, by remedy.
enum Failure {
    /// Another try may help.
    Passing(IoError),
    Final(IoError),
}

/// Requests bytes of a file, up to its end. A server may answer with fewer bytes than requested
/// (RFC 9110, section 15.3.7); then the rest is requested too.
///
/// # Errors
/// `Io` if the server does not return them after retries; `Usage` for an address that is not
/// encrypted.
pub fn fetch(address: &str, range: Range<u64>) -> Result<Answer> {
    let mut answer = answered(address, &range)?;
    let end = range.end.min(answer.length);
    while answer.start == range.start {
        let next = range.start + answer.bytes.len() as u64;
        if next >= end {
            break;
        }
        let rest = answered(address, &(next..end))?;
        let goes_on = rest.start == next
            && rest.length == answer.length
            && rest.version == answer.version
            && !rest.bytes.is_empty();
        if !goes_on {
            // The caller notices the missing bytes, and reports that the file has changed.
            break;
        }
        answer.bytes.extend(rest.bytes);
    }
    Ok(answer)
}

/// One answer, after as many tries as it takes.
fn answered(address: &str, range: &Range<u64>) -> Result<Answer> {
    if let Some(rest) = address.strip_prefix("http://")
        && !is_here(rest)
    {
        let message = "the address is not encrypted: only https:// is read from other machines";
        return Err(Error::usage(message).in_file(&shown(address)));
    }
    let mut pause = PAUSE;
    for _ in 1..TRIES {
        match once(address, range) {
            Ok(answer) => return Ok(answer),
            Err(Failure::Final(error)) => return Err(Error::io(error, &shown(address))),
            Err(Failure::Passing(_)) => std::thread::sleep(pause),
        }
        pause *= 4;
    }
    once(address, range).map_err(|failure| {
        let (Failure::Passing(error) | Failure::Final(error)) = failure;
        Error::io(error, &shown(address))
    })
}

/// True for an address of this machine, without its scheme.
fn is_here(rest: &str) -> bool {
    let host = rest.split(['/', '?', '#']).next().unwrap_or_default();
    let name = host.rsplit_once(':').map_or(host, |(name, _)| name);
    ["127.0.0.1", "localhost", "[::1]"].contains(&name)
}

fn once(address: &str, range: &Range<u64>) -> std::result::Result<Answer, Failure> {
    let asked = format!("bytes={}-{}", range.start, range.end - 1);
    // Without compression: ranges are those of the file.
    let request = AGENT.get(address).header("Range", &asked).header("Accept-Encoding", "identity");
    let mut response = request.call().map_err(|error| match error {
        // Untrusted certificates are not retried.
        ureq::Error::Io(error) if error.kind() == Kind::InvalidData => Failure::Final(error),
        ureq::Error::Io(_) | ureq::Error::Timeout(_) | ureq::Error::ConnectionFailed => {
            Failure::Passing(error.into_io())
        }
        other => Failure::Final(other.into_io()),
    })?;
    let whole = range.end - range.start;
    let (start, length, most) = match response.status() {
        StatusCode::PARTIAL_CONTENT => {
            let (part, length) = content_range(response.headers()).ok_or_else(|| {
                let message = "the server's answer does not say which bytes it holds";
                Failure::Final(IoError::new(Kind::InvalidData, message))
            })?;
            (part.start, Some(length), whole.min(part.end - part.start))
        }
        StatusCode::OK => (0, content_length(response.headers()), LARGEST_WHOLE),
        // An empty file has no valid range.
        StatusCode::RANGE_NOT_SATISFIABLE if range.start == 0 => {
            let version = version(response.headers());
            return Ok(Answer { start: 0, bytes: Vec::new(), length: 0, version });
        }
        status => return Err(refused(status)),
    };
    let version = version(response.headers());
    let bytes = body(&mut response, most)?;
    let length = length.unwrap_or(bytes.len() as u64);
    Ok(Answer { start, bytes, length, version })
}

fn body(response: &mut Response<ureq::Body>, most: u64) -> std::result::Result<Vec<u8>, Failure> {
    let mut bytes = Vec::new();
    let reader = response.body_mut().as_reader();
    let read = reader.take(most + 1).read_to_end(&mut bytes);
    read.map_err(Failure::Passing)?;
    if bytes.len() as u64 <= most {
        return Ok(bytes);
    }
    let message = "the server sends the whole file, and no ranges of it: download it";
    Err(Failure::Final(IoError::new(Kind::Unsupported, message)))
}

fn refused(status: StatusCode) -> Failure {
    let message = format!("the server answers {status}");
    let passes = status.is_server_error()
        || [StatusCode::TOO_MANY_REQUESTS, StatusCode::REQUEST_TIMEOUT].contains(&status);
    let kind = match status {
        StatusCode::NOT_FOUND | StatusCode::GONE => Kind::NotFound,
        StatusCode::UNAUTHORIZED | StatusCode::FORBIDDEN => Kind::PermissionDenied,
        _ => Kind::Other,
    };
    let error = IoError::new(kind, message);
    if passes { Failure::Passing(error) } else { Failure::Final(error) }
}

fn text<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    headers.get(name).and_then(|value| value.to_str().ok())
}

/// The bytes of a part, and the length of the whole.
fn content_range(headers: &HeaderMap) -> Option<(Range<u64>, u64)> {
    let range = text(headers, "content-range")?.strip_prefix("bytes ")?;
    let (part, length) = range.split_once('/')?;
    let (first, last) = part.split_once('-')?;
    let (first, last) = (first.parse().ok()?, last.parse::<u64>().ok()?);
    let is_part = first <= last;
    is_part.then(|| Some((first..last.checked_add(1)?, length.parse().ok()?)))?
}

fn content_length(headers: &HeaderMap) -> Option<u64> {
    text(headers, "content-length")?.parse().ok()
}

fn version(headers: &HeaderMap) -> Option<String> {
    text(headers, "etag").or_else(|| text(headers, "last-modified")).map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_machine_is_told_from_others() {
        for (rest, here) in [
            ("127.0.0.1:80/a", true),
            ("localhost", true),
            ("[::1]:8080/a", true),
            ("localhost.example/a", false),
            ("example/localhost", false),
            ("me@example:80/127.0.0.1", false),
        ] {
            assert_eq!(is_here(rest), here, "{rest}");
        }
    }
}
