//! The head of an HTTP/1.1 request, read strictly and within limits.

use std::io::Read;
use std::net::{IpAddr, SocketAddr};

/// Bytes of a request's head, at most.
const MAX_BYTES: usize = 16 << 10;
/// Fields of a head, at most.
const MAX_FIELDS: usize = 100;

/// A request that can be answered.
#[derive(Debug, PartialEq, Eq)]
pub struct Request {
    /// True if only the answer's head is wanted.
    pub is_head: bool,
    /// The target without its query.
    pub path: String,
    /// The field `Range`, if it applies.
    pub range: Option<String>,
    /// True if another request may follow on the connection.
    pub keeps_alive: bool,
}

/// Reasons to refuse a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// Not HTTP, or a request with a body.
    Malformed,
    /// Another method than GET and HEAD.
    Method,
    /// For another host: a foreign page whose name was made to resolve to this machine (DNS
    /// rebinding).
    Host,
    /// A head beyond the limits.
    TooLarge,
    /// Another version than 1.0 and 1.1.
    Version,
}

impl Refusal {
    /// The readable message of the answer.
    pub fn words(self) -> &'static str {
        match self {
            Self::Host => {
                "This viewer answers to the names of its own machine alone: localhost, 127.0.0.1 or \
                 [::1]. From another machine, make a tunnel with `ssh -L 8080:localhost:PORT MACHINE` \
                 and open http://localhost:8080, or start the viewer with --host.\n"
            }
            _ => "",
        }
    }

    /// The answer's status.
    pub fn status(self) -> &'static str {
        match self {
            Self::Malformed => "400 Bad Request",
            Self::Method => "405 Method Not Allowed\r\nAllow: GET, HEAD",
            Self::Host => "421 Misdirected Request",
            Self::TooLarge => "431 Request Header Fields Too Large",
            Self::Version => "505 HTTP Version Not Supported",
        }
    }
}

/// Requests of a connection, one after the other.
pub struct Reader<R> {
    stream: R,
    /// Received bytes that are not part of a request yet.
    buffer: Vec<u8>,
}

impl<R: Read> Reader<R> {
    /// At the start of a connection.
    pub fn new(stream: R) -> Self {
        Self { stream, buffer: Vec::new() }
    }

    /// The next request to a server at `address`; none if the connection ends first.
    pub fn next(
        &mut self,
        address: SocketAddr,
    ) -> std::io::Result<Option<Result<Request, Refusal>>> {
        let mut looked_at = 0;
        loop {
            // The end may straddle two reads.
            let from = looked_at.max(3) - 3;
            if let Some(found) = self.buffer[from..].windows(4).position(|end| end == b"\r\n\r\n") {
                let head: Vec<u8> = self.buffer.drain(..from + found + 4).collect();
                return Ok(Some(parse(&head[..head.len() - 4], address)));
            }
            looked_at = self.buffer.len();
            if looked_at >= MAX_BYTES {
                return Ok(Some(Err(Refusal::TooLarge)));
            }
            let mut piece = [0; 4096];
            let count = self.stream.read(&mut piece)?;
            if count == 0 {
                return Ok(None);
            }
            self.buffer.extend_from_slice(&piece[..count]);
        }
    }
}

/// Parses a head without its last two line ends.
fn parse(head: &[u8], address: SocketAddr) -> Result<Request, Refusal> {
    // Fields may hold other bytes than ASCII, but not the bytes that are tested here.
    let text = std::str::from_utf8(head).map_err(|_| Refusal::Malformed)?;
    if text.bytes().any(|byte| byte.is_ascii_control() && !matches!(byte, b'\r' | b'\n' | b'\t')) {
        return Err(Refusal::Malformed);
    }
    let mut lines = text.split("\r\n");
    let words: Vec<&str> = lines.next().unwrap_or_default().split(' ').collect();
    let [method, target, version] = words[..] else { return Err(Refusal::Malformed) };
    let mut keeps_alive = match version {
        "HTTP/1.1" => true,
        "HTTP/1.0" => false,
        _ if version.starts_with("HTTP/") => return Err(Refusal::Version),
        _ => return Err(Refusal::Malformed),
    };
    let is_head = match method {
        "GET" => false,
        "HEAD" => true,
        _ => return Err(Refusal::Method),
    };
    if !target.starts_with('/') {
        return Err(Refusal::Malformed);
    }
    let path = target.split('?').next().unwrap_or_default().to_owned();
    let (mut host, mut range, mut is_conditional) = (None, None, false);
    for (count, line) in lines.enumerate() {
        if count == MAX_FIELDS {
            return Err(Refusal::TooLarge);
        }
        let (name, value) = line.split_once(':').ok_or(Refusal::Malformed)?;
        // Lone line ends, folded lines and spaces before the colon enable request smuggling.
        let is_name = !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_graphic());
        if !is_name || value.contains(['\r', '\n']) {
            return Err(Refusal::Malformed);
        }
        let value = value.trim_matches([' ', '\t']);
        match name.to_ascii_lowercase().as_str() {
            "host" if host.replace(value).is_some() => return Err(Refusal::Malformed),
            "range" if range.replace(value.to_owned()).is_some() => {
                return Err(Refusal::Malformed);
            }
            "if-range" => is_conditional = true,
            "connection" if closes(value) => keeps_alive = false,
            // No resource accepts a body.
            "content-length" if value != "0" => return Err(Refusal::Malformed),
            "transfer-encoding" => return Err(Refusal::Malformed),
            _ => {}
        }
    }
    // Ranges are defined only for GET, and no answer has a validator for conditions.
    let range = range.filter(|_| !is_head && !is_conditional);
    match host {
        Some(host) if is_here(host, address) => Ok(Request { is_head, path, range, keeps_alive }),
        _ => Err(Refusal::Host),
    }
}

/// True if the list in the field `Connection` requests closing it.
fn closes(value: &str) -> bool {
    value.split(',').any(|option| option.trim().eq_ignore_ascii_case("close"))
}

/// True for a name of this machine with any port, because tunnels have their own ports. A foreign
/// page can make its own name resolve to this machine, but not an IP address or `localhost`. So
/// other names are refused, and IP addresses are accepted: those of this machine, or all if other
/// machines are allowed.
fn is_here(host: &str, address: SocketAddr) -> bool {
    let name = match host.rsplit_once(':') {
        // IPv6 addresses contain colons, in brackets.
        Some((name, port)) if !port.contains(']') => {
            if !port.bytes().all(|byte| byte.is_ascii_digit()) {
                return false;
            }
            name
        }
        _ => host,
    };
    let number = name.strip_prefix('[').and_then(|name| name.strip_suffix(']'));
    let number = number.unwrap_or(name).parse::<IpAddr>();
    let is_own = |number: IpAddr| number.is_loopback() || number == address.ip();
    name.eq_ignore_ascii_case("localhost")
        || number.is_ok_and(|number| is_own(number) || !address.ip().is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    const HERE: ([u8; 4], u16) = ([127, 0, 0, 1], 8080);

    fn first(bytes: &str) -> Option<Result<Request, Refusal>> {
        Reader::new(bytes.as_bytes()).next(HERE.into()).expect("memory can be read")
    }

    #[test]
    fn requests_are_read_one_by_one_however_they_arrive() {
        /// A byte at a time.
        struct Slow<'a>(&'a [u8]);
        impl Read for Slow<'_> {
            fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
                let count = self.0.len().min(1);
                out[..count].copy_from_slice(&self.0[..count]);
                self.0 = &self.0[count..];
                Ok(count)
            }
        }
        let text = "GET /a?b=/../c HTTP/1.1\r\nHost: localhost:8080\r\nRange: bytes=1-2\r\n\r\n\
                    HEAD / HTTP/1.1\r\nhOST:127.0.0.1:8080\r\nConnection: close\r\n\r\n";
        let mut reader = Reader::new(Slow(text.as_bytes()));
        let mut next = || reader.next(HERE.into()).expect("memory can be read");
        let range = Some("bytes=1-2".to_owned());
        let get = Request { is_head: false, path: "/a".into(), range, keeps_alive: true };
        let head = Request { is_head: true, path: "/".into(), range: None, keeps_alive: false };
        assert_eq!(next(), Some(Ok(get)));
        assert_eq!(next(), Some(Ok(head)));
        assert_eq!(next(), None);
    }

    #[test]
    fn ranges_count_where_they_are_defined() {
        let range = |method: &str, more: &str| {
            let text = format!(
                "{method} / HTTP/1.1\r\nHost: localhost:8080\r\nRange: bytes=1-2\r\n{more}\r\n"
            );
            first(&text).expect("a request").expect("understood").range
        };
        assert_eq!(range("GET", ""), Some("bytes=1-2".to_owned()));
        assert_eq!(range("HEAD", ""), None);
        assert_eq!(range("GET", "If-Range: \"etag\"\r\n"), None);
    }

    #[test]
    fn hosts_are_compared_as_browsers_write_them() {
        let at = |port: u16, host: &str| is_here(host, (HERE.0, port).into());
        for (port, host, here) in [
            (8080, "LocalHost:8080", true),
            // The port may be forwarded.
            (8080, "127.0.0.1", true),
            (8080, "127.0.0.1:9000", true),
            (80, "127.0.0.1", true),
            (80, "localhost:80", true),
            (80, "localhost.evil.example", false),
            (80, "evil.example", false),
            (80, "", false),
        ] {
            assert_eq!(at(port, host), here, "{host} at {port}");
        }
        let at = |host: &str| is_here(host, ([0, 0, 0, 0], 8080).into());
        for (host, here) in [
            ("192.168.1.7:8080", true),
            ("[fe80::1]:8080", true),
            ("localhost:8080", true),
            ("192.168.1.7:80", true),
            ("colleague.example:8080", false),
            ("192.168.1.7.evil.example:8080", false),
        ] {
            assert_eq!(at(host), here, "{host} where all are let in");
        }
        assert!(!is_here("192.168.1.7:8080", (HERE.0, 8080).into()));
    }

    #[test]
    fn a_connection_ends_where_a_list_says_so() {
        for (value, stays) in [("close", false), ("TE, Close", false), ("keep-alive", true)] {
            let text =
                format!("GET / HTTP/1.1\r\nHost: localhost:8080\r\nConnection: {value}\r\n\r\n");
            let request = first(&text).expect("a request").expect("understood");
            assert_eq!(request.keeps_alive, stays, "{value}");
        }
    }

    #[test]
    fn everything_else_is_refused() {
        let host = "Host: localhost:8080\r\n";
        let twice = "Range: bytes=0-1\r\nRange: bytes=3-4\r\n";
        let many = "X: y\r\n".repeat(MAX_FIELDS + 1);
        let cases = [
            (format!("POST / HTTP/1.1\r\n{host}\r\n"), Refusal::Method),
            (format!("GET / HTTP/2\r\n{host}\r\n"), Refusal::Version),
            (format!("GET / FTP/1\r\n{host}\r\n"), Refusal::Malformed),
            (format!("GET  / HTTP/1.1\r\n{host}\r\n"), Refusal::Malformed),
            (format!("GET http://localhost:8080/ HTTP/1.1\r\n{host}\r\n"), Refusal::Malformed),
            (format!("GET / HTTP/1.1\r\n{host}Content-Length: 5\r\n\r\n"), Refusal::Malformed),
            (format!("GET / HTTP/1.1\r\n{host}Transfer-Encoding: x\r\n\r\n"), Refusal::Malformed),
            (format!("GET / HTTP/1.1\r\n{host}{host}\r\n"), Refusal::Malformed),
            (format!("GET / HTTP/1.1\r\n{host}{twice}\r\n"), Refusal::Malformed),
            (format!("GET / HTTP/1.1\r\n{host} folded: x\r\n\r\n"), Refusal::Malformed),
            (format!("GET / HTTP/1.1\r\n{host}Range : x\r\n\r\n"), Refusal::Malformed),
            (format!("GET / HTTP/1.1\r\n{host}X: y\nZ: w\r\n\r\n"), Refusal::Malformed),
            (format!("GET /\0 HTTP/1.1\r\n{host}\r\n"), Refusal::Malformed),
            (format!("GET / HTTP/1.1\r\n{host}{many}\r\n"), Refusal::TooLarge),
            ("GET / HTTP/1.1\r\n\r\n".to_owned(), Refusal::Host),
            ("GET / HTTP/1.1\r\nHost: evil.example:8080\r\n\r\n".to_owned(), Refusal::Host),
            ("GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n".to_owned(), Refusal::Host),
            ("GET / HTTP/1.1\r\nHost: localhost.evil:8080\r\n\r\n".to_owned(), Refusal::Host),
            ("GET / HTTP/1.1\r\nHost: localhost:evil\r\n\r\n".to_owned(), Refusal::Host),
            ("GET / HTTP/1.1\r\nHost: 192.0.2.1:8080\r\n\r\n".to_owned(), Refusal::Host),
            (format!("GET /{}", "x".repeat(MAX_BYTES)), Refusal::TooLarge),
        ];
        for (text, want) in cases {
            assert_eq!(first(&text), Some(Err(want)), "{}", &text[..text.len().min(80)]);
        }
        // Empty or incomplete heads.
        assert_eq!(first(""), None);
        assert_eq!(first("GET / HTTP/1.1\r\nHost: loc"), None);
    }
}
