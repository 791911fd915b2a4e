//! `view`: the server's answers and refusals.
use crate::common;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};

use crate::common::{assert_schema, fixture, folder};

/// The program, serving until it is dropped.
struct Served {
    child: Child,
    port: u16,
    report: serde_json::Value,
}

impl Served {
    fn start(file: &std::path::Path) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mipvog-bake"));
        command.args(["view", "--no-open", "--quiet", "--format", "json"]).arg(file);
        let mut child = command.stdout(Stdio::piped()).spawn().expect("the program starts");
        let mut text = String::new();
        let mut lines = BufReader::new(child.stdout.take().expect("piped")).lines();
        while serde_json::from_str::<serde_json::Value>(&text).is_err() {
            text += &lines.next().expect("the report ends").expect("text");
        }
        let report: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let port = report["port"].as_u64().expect("a port") as u16;
        Self { child, port, report }
    }

    fn connect(&self) -> TcpStream {
        TcpStream::connect(("127.0.0.1", self.port)).expect("it listens")
    }

    /// Sends a request with these lines after `Host`, on a connection of its own.
    fn ask(&self, first: &str, more: &str) -> Answer {
        let mut stream = self.connect();
        let text = format!("{first}\r\nHost: localhost:{}\r\n{more}\r\n", self.port);
        stream.write_all(text.as_bytes()).expect("sent");
        Answer::read(&mut BufReader::new(stream), first.starts_with("HEAD"))
    }
}

/// The lines that `view` says on stderr until it serves.
fn said(file: &std::path::Path, options: &[&str]) -> Vec<String> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mipvog-bake"));
    command
        .args(["view", "--no-open"])
        .args(options)
        .arg(file)
        .stdout(Stdio::null())
        .stderr(Stdio::piped());
    let mut child = command.spawn().expect("the program starts");
    let lines = BufReader::new(child.stderr.take().expect("piped")).lines();
    let lines = lines.map(|line| line.expect("text"));
    let said = lines.take_while(|line| !line.starts_with("serving")).collect();
    child.kill().ok();
    child.wait().ok();
    said
}

#[test]
fn a_container_that_was_cut_is_named() {
    let folder = folder();
    let whole = fixture("baked/tiny.rate.mipvog");
    assert_eq!(said(&whole, &[]), Vec::<String>::new());
    let bytes = std::fs::read(&whole).expect("a container");
    let inspect = Command::new(env!("CARGO_BIN_EXE_mipvog-bake"))
        .args(["inspect", "--format", "json"])
        .arg(&whole)
        .output();
    let report: serde_json::Value =
        serde_json::from_slice(&inspect.expect("starts").stdout).expect("a report");
    let levels = report["levels"].as_array().expect("levels");
    let prefix = levels[1]["prefix_bytes"].as_u64().expect("bytes") as usize;
    let cut = folder.path().join("cut.mipvog");
    std::fs::write(&cut, &bytes[..prefix]).expect("writable");
    let missing = format!("the finest 1 of {} levels are missing", levels.len());
    assert_eq!(said(&cut, &[]), [format!("warning: the file ends early: {missing}")]);
    std::fs::write(&cut, &bytes[..prefix + 1]).expect("writable");
    let lines = said(&cut, &[]);
    assert!(lines[0].contains("the file ends within a level") && lines.len() == 1, "{lines:?}");
}

impl Drop for Served {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

struct Answer {
    status: u16,
    head: String,
    body: Vec<u8>,
}

impl Answer {
    fn read(stream: &mut impl BufRead, is_head: bool) -> Self {
        let mut head = String::new();
        while !head.ends_with("\r\n\r\n") {
            assert_ne!(stream.read_line(&mut head).expect("a head"), 0, "{head}");
        }
        let status = head[9..12].parse().expect("a status");
        let mut answer = Self { status, head, body: Vec::new() };
        let length: usize = answer.field("Content-Length").parse().expect("a length");
        answer.body = vec![0; if is_head { 0 } else { length }];
        stream.read_exact(&mut answer.body).expect("a body");
        answer
    }

    fn field(&self, name: &str) -> &str {
        let start = format!("{name}: ");
        self.head.lines().find_map(|line| line.strip_prefix(&start)).unwrap_or_default()
    }
}

#[test]
fn the_viewer_and_the_file_are_served_in_whole_and_in_parts() {
    let file = fixture("baked/tiny.rate.mipvog");
    let bytes = std::fs::read(&file).expect("a fixture");
    let served = Served::start(&file);
    assert_schema("view", &served.report);
    assert_eq!(served.report["kind"], "container");
    let url = format!("http://127.0.0.1:{}/?file=field.mipvog&name=tiny.rate.mipvog", served.port);
    assert_eq!(served.report["url"], url);

    for (name, start) in [("/", "<!doctype html>"), ("/?file=field.mipvog", "<!doctype html>")] {
        let answer = served.ask(&format!("GET {name} HTTP/1.1"), "");
        assert_eq!(answer.status, 200);
        assert!(answer.body.starts_with(start.as_bytes()));
        assert!(answer.field("Content-Security-Policy").starts_with("default-src 'none'"));
    }
    for name in ["viewer.js", "worker.js", "decoders.js", "style.css"] {
        let answer = served.ask(&format!("GET /{name} HTTP/1.1"), "");
        let path = fixture("../viewer/dist").join(name);
        assert!(answer.body == std::fs::read(path).expect("a committed build"), "{name}");
    }
    let whole = served.ask("GET /field.mipvog HTTP/1.1", "");
    assert_eq!((whole.status, whole.field("Accept-Ranges")), (200, "bytes"));
    assert!(whole.body == bytes);
    let length = bytes.len();
    let parts = [("100-299", 100..300), ("9000-", 9000..length), ("-64", length - 64..length)];
    for (range, want) in parts {
        let answer = served.ask("GET /field.mipvog HTTP/1.1", &format!("Range: bytes={range}\r\n"));
        assert_eq!(answer.status, 206);
        let stated = format!("bytes {}-{}/{length}", want.start, want.end - 1);
        assert_eq!(answer.field("Content-Range"), stated);
        assert!(answer.body == bytes[want], "{range}");
    }
    let beyond = served.ask("GET /field.mipvog HTTP/1.1", "Range: bytes=9999999-\r\n");
    assert_eq!((beyond.status, beyond.body.len()), (416, 0));
    assert_eq!(beyond.field("Content-Range"), format!("bytes */{length}"));
    let head = served.ask("HEAD /field.mipvog HTTP/1.1", "");
    assert_eq!((head.status, head.field("Content-Length")), (200, &*length.to_string()));
    // Ranges are GET's alone, and nothing was promised that a condition could hold by.
    let head = served.ask("HEAD /field.mipvog HTTP/1.1", "Range: bytes=0-0\r\n");
    assert_eq!((head.status, head.field("Content-Length")), (200, &*length.to_string()));
    let changed = "Range: bytes=0-0\r\nIf-Range: \"other\"\r\n";
    let answer = served.ask("GET /field.mipvog HTTP/1.1", changed);
    assert!(answer.status == 200 && answer.body == bytes);
    for (first, more) in
        [("GET / HTTP/1.0", ""), ("GET /none HTTP/1.1", "Connection: te, close\r\n")]
    {
        assert_eq!(served.ask(first, more).field("Connection"), "close", "{first}");
    }
}

#[test]
fn nothing_else_is_served() {
    let served = Served::start(&fixture("baked/tiny.rate.mipvog"));
    let outside =
        ["/../Cargo.toml", "/%2e%2e/Cargo.toml", "//viewer.js", "/field.mipvog/", "/asset.glb"];
    for path in outside {
        assert_eq!(served.ask(&format!("GET {path} HTTP/1.1"), "").status, 404, "{path}");
    }
    assert_eq!(served.ask("POST / HTTP/1.1", "").status, 405);
    assert_eq!(served.ask("GET http://localhost/ HTTP/1.1", "").status, 400);
    assert_eq!(served.ask("GET / HTTP/3", "").status, 505);
    // A page of another host, whose name was made to point here.
    let mut stream = served.connect();
    stream.write_all(b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n").expect("sent");
    assert_eq!(Answer::read(&mut BufReader::new(stream), false).status, 421);
}

#[test]
fn connections_live_on_and_beside_each_other() {
    let file = fixture("baked/tiny.rate.mipvog");
    let bytes = std::fs::read(&file).expect("a fixture");
    let served = Served::start(&file);
    // Silent connections do not block others.
    let silent: Vec<TcpStream> = (0..20).map(|_| served.connect()).collect();
    let ask = |from: usize| {
        let mut stream = BufReader::new(served.connect());
        for at in (from..bytes.len()).step_by(997).take(20) {
            let request = format!(
                "GET /field.mipvog HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nRange: bytes={at}-{at}\r\n\r\n",
                served.port
            );
            stream.get_mut().write_all(request.as_bytes()).expect("sent");
            assert_eq!(Answer::read(&mut stream, false).body, [bytes[at]]);
        }
    };
    std::thread::scope(|scope| {
        (0..8).for_each(|from| drop(scope.spawn(move || ask(from))));
    });
    drop(silent);
}

#[test]
fn a_binary_asset_is_served_as_it_is_and_other_files_are_refused() {
    let folder = folder();
    let asset = folder.path().join("no.alpha");
    std::fs::write(&asset, b"glTF\x02\0\0\0\x0c\0\0\0").expect("a file");
    let served = Served::start(&asset);
    assert_eq!(served.report["kind"], "asset");
    let answer = served.ask("GET /asset.glb HTTP/1.1", "");
    assert_eq!((answer.field("Content-Type"), answer.body.len()), ("model/gltf-binary", 12));

    // Files that it names are not served with it, and the program says so.
    let outside = folder.path().join("outside.glb");
    let field =
        "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"uri\":\"beside.bin\",\"byteLength\":4}]}";
    std::fs::write(&outside, common::asset::glb(field, &[])).expect("a file");
    let mut command = Command::new(env!("CARGO_BIN_EXE_mipvog-bake"));
    command.args(["view", "--no-open"]).arg(&outside);
    let piped = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
    let mut child = piped.expect("the program starts");
    let first = BufReader::new(child.stderr.take().expect("piped")).lines().next();
    child.kill().and_then(|()| child.wait()).expect("it ends");
    let warning = first.expect("a line").expect("text");
    assert!(warning.contains("not served: beside.bin"), "{warning}");

    let view = |file: &std::path::Path, more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mipvog-bake"));
        let output = command.args(["view", "--no-open"]).args(more).arg(file).output();
        let output = output.expect("the program starts");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, message) = view(&fixture("trained/hostile/text.txt"), &[]);
    assert_eq!(code, Some(3), "{message}");
    assert!(message.contains("text.txt") && message.contains("a .mipvog container"), "{message}");
    assert_eq!(view(&folder.path().join("not.there"), &[]).0, Some(5));
    // A port that is taken.
    let (code, message) = view(&asset, &["--port", &served.port.to_string()]);
    assert_eq!(code, Some(5), "{message}");
}

#[test]
fn others_are_let_in_with_a_warning() {
    let here = folder();
    let path = here.path().join("scene.mipvog");
    std::fs::copy(fixture("baked/tiny.rate.mipvog"), &path).expect("copied");
    let warned = |options: &[&str]| {
        said(&path, options).iter().any(|line| line.contains("without a password"))
    };
    assert!(warned(&["--host", "0.0.0.0"]));
    assert!(!warned(&[]) && !warned(&["--host", "127.0.0.1"]));
    let output = common::program()
        .args(["view", "--no-open", "--host", "192.0.2.1"])
        .arg(&path)
        .output()
        .expect("it runs");
    assert_eq!(output.status.code(), Some(5), "an address of no machine");
}
