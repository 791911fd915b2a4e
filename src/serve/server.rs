//! Accepts connections and answers each in its own thread.

use std::io::Write;
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use super::range::{self, Asked};
use super::request::{self, Refusal, Request};
use super::site::{self, Body, Resource, Site};
use crate::base::error::{Error, Result};

/// Connections at a time, at most; a browser opens six.
const MAX_CONNECTIONS: usize = 64;

/// Timeout of a silent connection.
const SILENCE: Duration = Duration::from_secs(60);

/// Pause after a failed accept.
const PAUSE: Duration = Duration::from_millis(20);

/// Bytes of a file that are read at once.
const PIECE: u64 = 256 << 10;

/// A bound server.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    site: Arc<Site>,
}

impl Server {
    /// Binds `port` of an address of this machine; 0 takes a free one.
    ///
    /// # Errors
    /// The address does not belong to this machine, or the port is taken or not allowed.
    pub fn bind(host: IpAddr, port: u16, site: Site) -> Result<Self> {
        let place = || std::path::PathBuf::from(SocketAddr::new(host, port).to_string());
        let io = |error| Error::io(error, &place());
        let listener = TcpListener::bind((host, port)).map_err(io)?;
        let address = listener.local_addr().map_err(io)?;
        Ok(Self { listener, address, site: Arc::new(site) })
    }

    /// The address of the server.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The page's address with the file to open and its display name.
    pub fn url(&self) -> String {
        let name = escaped(&self.site.file_name());
        let mut address = self.address;
        if address.ip().is_unspecified() {
            address.set_ip(own_address(address.ip()));
        }
        format!("http://{address}/?file={}&name={name}", self.site.kind().name())
    }

    /// Answers forever. Broken connections are ignored.
    pub fn run(&self) {
        let open = Arc::new(AtomicUsize::new(0));
        for connection in self.listener.incoming() {
            let Ok(connection) = connection else {
                // The system may be out of file descriptors. Retrying immediately would only waste
                // time.
                std::thread::sleep(PAUSE);
                continue;
            };
            // Dropped if there are too many; browsers retry.
            if open.fetch_add(1, Ordering::AcqRel) >= MAX_CONNECTIONS {
                open.fetch_sub(1, Ordering::AcqRel);
                continue;
            }
            let guard = Guard(Arc::clone(&open));
            let (site, address) = (Arc::clone(&self.site), self.address);
            let work = move || {
                let _guard = guard;
                answer_all(&connection, &site, address).ok();
            };
            // Without a thread, the connection and its count are dropped.
            std::thread::Builder::new().spawn(work).ok();
        }
    }
}

/// The address of this machine in the network, if it has one; else its loopback address. Nothing is
/// sent: the system only selects the source address.
fn own_address(any: IpAddr) -> IpAddr {
    // Addresses for documentation, RFC 5737 and RFC 3849, which are never assigned.
    let (elsewhere, loopback): (SocketAddr, IpAddr) = match any {
        IpAddr::V4(_) => (([192, 0, 2, 1], 9).into(), std::net::Ipv4Addr::LOCALHOST.into()),
        IpAddr::V6(_) => {
            (([0x2001, 0xdb8, 0, 0, 0, 0, 0, 1], 9).into(), std::net::Ipv6Addr::LOCALHOST.into())
        }
    };
    let socket = UdpSocket::bind((any, 0)).and_then(|socket| {
        socket.connect(elsewhere)?;
        socket.local_addr()
    });
    socket.map_or(loopback, |own| own.ip())
}

/// Text as a query value, RFC 3986 section 2: all but unreserved characters are percent-encoded.
fn escaped(text: &str) -> String {
    let escape = |byte: u8| match byte {
        b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => {
            char::from(byte).to_string()
        }
        _ => format!("%{byte:02X}"),
    };
    text.bytes().map(escape).collect()
}

/// A guard that counts a connection until it ends.
struct Guard(Arc<AtomicUsize>);

impl Drop for Guard {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

/// Answers requests of a connection until it ends.
fn answer_all(stream: &TcpStream, site: &Site, address: SocketAddr) -> std::io::Result<()> {
    stream.set_read_timeout(Some(SILENCE))?;
    stream.set_write_timeout(Some(SILENCE))?;
    stream.set_nodelay(true)?;
    let mut reader = request::Reader::new(stream);
    loop {
        match reader.next(address)? {
            None => return Ok(()),
            Some(Ok(request)) => {
                answer(stream, site, &request)?;
                if !request.keeps_alive {
                    return Ok(());
                }
            }
            // Bytes behind an invalid request are meaningless.
            Some(Err(refusal)) => return refuse(stream, refusal),
        }
    }
}

fn answer(stream: &TcpStream, site: &Site, request: &Request) -> std::io::Result<()> {
    let connection = if request.keeps_alive { "" } else { "Connection: close\r\n" };
    let Some(resource) = site.get(&request.path) else {
        let head = format!("HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n{connection}\r\n");
        return send(stream, head.as_bytes());
    };
    let length = resource.length();
    let (status, bytes, extra) = match range::asked(request.range.as_deref(), length) {
        Asked::Whole => ("200 OK", 0..length, String::new()),
        Asked::Part(part) => {
            let extra =
                format!("Content-Range: bytes {}-{}/{length}\r\n", part.start, part.end - 1);
            ("206 Partial Content", part, extra)
        }
        Asked::Nothing => {
            let extra = format!("Content-Range: bytes */{length}\r\n");
            ("416 Range Not Satisfiable", 0..0, extra)
        }
    };
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {}\r\nContent-Length: {}\r\nAccept-Ranges: bytes\r\n\
         {extra}{connection}{}\r\n",
        resource.media_type,
        bytes.end - bytes.start,
        site::SAFETY_HEADERS,
    );
    send(stream, head.as_bytes())?;
    if request.is_head { Ok(()) } else { send_body(stream, &resource, bytes) }
}

fn send_body(stream: &TcpStream, resource: &Resource, bytes: Range<u64>) -> std::io::Result<()> {
    let file = match &resource.body {
        Body::Inside(body) => {
            return send(stream, &body[bytes.start as usize..bytes.end as usize]);
        }
        Body::File(file) => file,
    };
    let mut piece = vec![0; PIECE.min(bytes.end - bytes.start) as usize];
    let mut at = bytes.start;
    while at < bytes.end {
        let count = PIECE.min(bytes.end - at) as usize;
        // A file that shrank cannot be sent completely: the connection ends before the stated
        // length.
        file.read_into(at, &mut piece[..count]).map_err(std::io::Error::other)?;
        send(stream, &piece[..count])?;
        at += count as u64;
    }
    Ok(())
}

fn refuse(stream: &TcpStream, refusal: Refusal) -> std::io::Result<()> {
    let (status, words) = (refusal.status(), refusal.words());
    let length = words.len();
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: text/plain; charset=utf-8\r\nContent-Length: {length}\r\n\
         Connection: close\r\n\r\n{words}"
    );
    send(stream, head.as_bytes())
}

fn send(mut stream: &TcpStream, bytes: &[u8]) -> std::io::Result<()> {
    stream.write_all(bytes)
}
