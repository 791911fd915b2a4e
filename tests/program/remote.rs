//! Inputs at addresses: only what is needed is fetched, and only when that is allowed. The server is
//! a plain one on this machine.

#![cfg(feature = "network")]

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::Output;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use crate::common::checkpoint::Checkpoint;
use crate::common::{fixture, folder, program};

/// What the server does wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    None,
    /// Every third request fails.
    Fails,
    /// It knows no ranges.
    Whole,
    /// The file is another one from the second request on.
    Changes,
    /// It ends answers early.
    Cuts,
    /// It answers with fewer bytes than it is asked for, and says so.
    Short,
    /// It answers with this status.
    Status(&'static str),
}

/// A server of one file.
struct Server {
    address: String,
    requests: Arc<AtomicUsize>,
    sent: Arc<AtomicU64>,
    heads: Arc<Mutex<Vec<String>>>,
}

impl Server {
    fn new(bytes: Vec<u8>, fault: Fault) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let address = format!("http://{}/scene.tar", listener.local_addr().expect("bound"));
        let (requests, sent) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicU64::new(0)));
        let heads = Arc::new(Mutex::new(Vec::new()));
        let own = (Arc::clone(&requests), Arc::clone(&sent), Arc::clone(&heads));
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                let Ok(stream) = stream else { return };
                let (requests, sent, heads) = &own;
                let number = requests.fetch_add(1, Ordering::SeqCst);
                answer(stream, &bytes, fault, number, sent, heads);
            }
        });
        Self { address, requests, sent, heads }
    }
}

/// Answers one request and closes.
fn answer(
    mut stream: TcpStream,
    bytes: &[u8],
    fault: Fault,
    number: usize,
    sent: &AtomicU64,
    heads: &Mutex<Vec<String>>,
) {
    let mut head = String::new();
    let mut lines = BufReader::new(stream.try_clone().expect("a stream")).lines();
    while let Some(Ok(line)) =
        lines.next().filter(|line| line.as_ref().is_ok_and(|l| !l.is_empty()))
    {
        head.push_str(&line.to_lowercase());
        head.push('\n');
    }
    let range = head.lines().find_map(|line| line.strip_prefix("range: bytes="));
    let range = range.and_then(|range| range.split_once('-'));
    let (first, last): (usize, usize) =
        range.map_or((0, 0), |(a, b)| (a.parse().expect("a byte"), b.parse().expect("a byte")));
    heads.lock().expect("no panic").push(head.clone());
    let mut put = |status: &str, fields: &str, body: &[u8]| {
        let length = body.len() + if fault == Fault::Cuts { 100 } else { 0 };
        let head = format!(
            "HTTP/1.1 {status}\r\nContent-Length: {length}\r\nConnection: close\r\n{fields}\r\n"
        );
        stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(body)).ok();
        sent.fetch_add(body.len() as u64, Ordering::SeqCst);
    };
    match fault {
        Fault::Fails if number % 3 == 1 => return put("503 Busy", "", b"later"),
        Fault::Whole => return put("200 OK", "", bytes),
        Fault::Status(status) => return put(status, "", b""),
        _ => {}
    }
    let most = if fault == Fault::Short { first + 3000 } else { usize::MAX };
    let end = (last + 1).min(bytes.len()).min(most);
    let version = if fault == Fault::Changes { number } else { 0 };
    let fields = format!(
        "ETag: \"{version}\"\r\nContent-Range: bytes {first}-{}/{}\r\n",
        end - 1,
        bytes.len()
    );
    put("206 Partial Content", &fields, &bytes[first..end]);
}

fn run(here: &Path, arguments: &[&str]) -> Output {
    program().current_dir(here).args(arguments).output().expect("it runs")
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn checkpoint() -> Vec<u8> {
    std::fs::read(fixture("trained/lego64/fine_last.tar")).expect("a fixture")
}

#[test]
fn a_fetched_bake_is_the_local_one() {
    let here = folder();
    std::fs::write(here.path().join("scene.tar"), checkpoint()).expect("writable");
    let options = ["--stepsize", "0.5"];
    let local =
        run(here.path(), &[&["bake", "scene.tar", "-o", "local.mipvog"], &options[..]].concat());
    assert!(local.status.success(), "{}", text(&local));
    for fault in [Fault::None, Fault::Fails, Fault::Whole, Fault::Short] {
        let server = Server::new(checkpoint(), fault);
        let bake = ["bake", &server.address, "--allow-network", "--force", "-o", "far.mipvog"];
        let far = run(here.path(), &[&bake[..], &options].concat());
        assert!(far.status.success(), "{fault:?}: {}", text(&far));
        let [far, local] = ["far.mipvog", "local.mipvog"]
            .map(|name| std::fs::read(here.path().join(name)).expect("a container"));
        assert!(far == local, "{fault:?}");
    }
}

#[test]
fn only_what_is_needed_is_fetched() {
    // A file whose second half no scene needs: an optimizer's state is as large.
    let here = folder();
    let needed = Checkpoint::sound().to_bytes();
    let mut padded = Checkpoint::sound();
    padded.arrays.push(("optimizer", vec![6 << 20], vec![7.0; 6 << 20]));
    let padded = padded.to_bytes();
    let server = Server::new(padded.clone(), Fault::None);
    let bake = ["bake", &server.address, "--allow-network", "-o", "far.mipvog"];
    let far = run(here.path(), &bake);
    assert!(far.status.success(), "{}", text(&far));
    let sent = server.sent.load(Ordering::SeqCst);
    assert!(sent < needed.len() as u64 + (5 << 20), "{sent} of {} bytes", padded.len());
    let requests = server.requests.load(Ordering::SeqCst);
    assert!(requests < 60, "{requests} requests");
    let heads = server.heads.lock().expect("no panic");
    assert!(heads.iter().all(|head| head.contains("accept-encoding: identity")));
    let listed = Server::new(padded.clone(), Fault::None);
    let output = run(here.path(), &["inspect", &listed.address, "--allow-network"]);
    assert!(output.status.success(), "{}", text(&output));
    let sent = listed.sent.load(Ordering::SeqCst);
    assert!(sent < padded.len() as u64 / 20, "{sent} bytes to list {}", padded.len());
}

#[test]
fn nothing_is_fetched_unasked() {
    let here = folder();
    let server = Server::new(checkpoint(), Fault::None);
    let output = run(here.path(), &["inspect", &server.address]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output).contains("--allow-network"), "{}", text(&output));
    assert_eq!(server.requests.load(Ordering::SeqCst), 0);
    let output = run(here.path(), &["inspect", "http://192.0.2.1/a.tar", "--allow-network"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output).contains("https://"), "{}", text(&output));
}

#[test]
fn failures_are_told() {
    let here = folder();
    for (fault, says) in [
        (Fault::Status("404 Not Found"), "404"),
        (Fault::Status("403 Forbidden"), "403"),
        (Fault::Status("500 Broken"), "500"),
        (Fault::Changes, "changed while it was read"),
        (Fault::Cuts, ""),
    ] {
        let server = Server::new(checkpoint(), fault);
        let address = format!("{}?sign=word", server.address);
        let address = if fault == Fault::Changes { &address } else { &server.address };
        let bake = ["bake", address, "--allow-network", "-o", "far.mipvog"];
        let output = run(here.path(), &bake);
        let told = text(&output);
        assert_eq!(output.status.code(), Some(5), "{fault:?}: {told}");
        assert!(told.contains(says) && told.contains("/scene.tar"), "{fault:?}: {told}");
        assert!(!told.contains("word"), "{told}");
        assert!(!here.path().join("far.mipvog").exists());
    }
    let gone = TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("bound");
    let address = format!("http://{gone}/a.tar");
    let output = run(here.path(), &["inspect", &address, "--allow-network"]);
    assert_eq!(output.status.code(), Some(5), "{}", text(&output));
}
