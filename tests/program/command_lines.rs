//! Hostile and mistaken command lines: each ends soon, with the documented exit code and without a
//! panic, touches no file that is not its output, and leaves nothing behind if it fails.
//!
//! `command_lines/lines.txt` has a table of them; those that need a shell are here.

#![cfg(unix)]

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::common::asset::glb;
use crate::common::{fixture, folder, program};

/// Lines of `arguments`, with exit codes and words of stderr.
const LINES: &str = include_str!("command_lines/lines.txt");
/// No line runs longer, though a machine of tests is busy.
const LONGEST: Duration = Duration::from_secs(10);
/// Folders that lines run in at a time.
const FOLDERS: usize = 2;

/// An asset that names files of all kinds beside it.
const ROOM: &str = r#"{"asset":{"version":"2.0"},"buffers":[{"uri":"buffer.bin","byteLength":4},
{"uri":"odd.gltf","byteLength":4},{"uri":"odd.mipvog","byteLength":4}],
"images":[{"uri":"photos/r_0.png"}]}"#;
/// A camera file, whose second frame has another picture or the same one.
const CAMERAS: &str = r#"{"camera_angle_x":0.7,"w":8,"h":8,"frames":[
{"file_path":"./photos/r_0","transform_matrix":[[1,0,0,0],[0,0,-1,-4],[0,1,0,0],[0,0,0,1]]},
{"file_path":"SECOND","transform_matrix":[[1,0,0,0],[0,0,-1,-3.9],[0,1,0,0],[0,0,0,1]]}]}"#;

fn run(here: &Path, arguments: &[&str]) -> Output {
    let mut command = program();
    command.current_dir(here).args(arguments).stdin(Stdio::null()).output().expect("starts")
}

fn succeed(here: &Path, line: &str) {
    let output = run(here, &line.split(' ').collect::<Vec<_>>());
    assert!(output.status.success(), "{line}: {}", message(&output));
}

fn message(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The files that lines name.
fn fill(here: &Path) {
    let write = |name: &str, bytes: &[u8]| fs::write(here.join(name), bytes).expect("writable");
    for name in ["s", "photos", "empty"] {
        fs::create_dir(here.join(name)).expect("writable");
    }
    for (from, to) in [
        ("trained/tiny/fine_last.tar", "tiny.tar"),
        ("trained/old/fine_last.tar", "s/fine_last.tar"),
        ("trained/old/coarse_last.tar", "s/coarse_last.tar"),
        ("baked/tiny.rate.mipvog", "a.mipvog"),
        ("baked/dvgo.mask.mipvog", "b.mipvog"),
        ("broken/sound.mipvog", "sound.mipvog"),
    ] {
        write(to, &fs::read(fixture(from)).expect("a fixture"));
    }
    write("s/scene.json", br#"{"stepsize":0.5,"near":0.1,"far":6,"background":1}"#);
    write("empty.mipvog", b"");
    write("text.txt", b"hello\n");
    write("cut.mipvog", &fs::read(here.join("a.mipvog")).expect("there")[..3000]);
    write("cams.json", CAMERAS.replace("SECOND", "./photos/r_1").as_bytes());
    write("same.json", CAMERAS.replace("SECOND", "./photos/r_0").as_bytes());
    let room =
        r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"name":"n"}]}"#;
    write("room.glb", &glb(room, &[]));
    write("room.gltf", ROOM.as_bytes());
    for name in ["buffer.bin", "odd.gltf", "odd.mipvog"] {
        write(name, b"1234");
    }
    succeed(here, "render a.mipvog --cameras cams.json -o photos -q");
    for name in ["r_0", "r_1"] {
        let photos = here.join("photos");
        fs::rename(photos.join(format!("{name}.s1.png")), photos.join(format!("{name}.png")))
            .expect("rendered");
    }
    succeed(here, "attach room.glb a.mipvog -o em.glb");
    succeed(here, "attach room.glb a.mipvog --external -o ex.glb");
    succeed(here, "attach room.gltf b.mipvog -o f.gltf");
    succeed(here, "unpack b.mipvog -o b.safetensors");
    succeed(here, "unpack b.mipvog --levels 1 -o part.safetensors");
    let sweep = "sweep s/fine_last.tar --cameras cams.json --bits 8 --filter rate-tent --repeat 1 \
                 --scales 1 -o sw";
    succeed(here, sweep);
    let links = [("a.mipvog", "link.mipvog"), ("nowhere", "dangling.mipvog"), ("loop", "loop")];
    for (to, name) in links.into_iter().chain([(".", "here"), ("/dev/null", "null")]) {
        symlink(to, here.join(name)).expect("a link");
    }
    fs::hard_link(here.join("a.mipvog"), here.join("hard.mipvog")).expect("a link");
    let made = Command::new("mkfifo").arg(here.join("fifo")).status();
    assert!(made.expect("mkfifo is there").success());
}

/// Everything in a folder and those below it, by its name from there: contents of files, places of
/// links.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).expect("a folder").flatten() {
        let (path, kind) = (entry.path(), entry.file_type().expect("a kind"));
        let name = PathBuf::from(entry.file_name());
        let bytes = if kind.is_dir() {
            found.extend(contents(&path).into_iter().map(|(below, b)| (name.join(below), b)));
            Vec::new()
        } else if kind.is_symlink() {
            fs::read_link(&path).expect("a link").into_os_string().into_encoded_bytes()
        } else if kind.is_file() {
            fs::read(&path).expect("a file")
        } else {
            Vec::new()
        };
        found.insert(name, bytes);
    }
    found
}

/// Runs a line, and returns all that is wrong with its outcome. Its outputs are removed.
fn faults(
    here: &Path,
    line: &str,
    run: impl FnOnce() -> Output,
    (codes, words): (&str, &str),
    before: &BTreeMap<PathBuf, Vec<u8>>,
) -> Vec<String> {
    let clock = Instant::now();
    let output = run();
    let took = clock.elapsed();
    let (code, said) = (output.status.code(), message(&output));
    let mut faults = Vec::new();
    if !codes.split(',').any(|known| known.parse() == Ok(code.unwrap_or(-1))) {
        faults.push(format!("ended with {code:?}, not {codes}"));
    }
    if !said.contains(words) {
        faults.push(format!("does not say {words:?}"));
    }
    if said.contains("panicked") {
        faults.push("panicked".to_owned());
    }
    if took > LONGEST {
        faults.push(format!("took {took:?}"));
    }
    let mut after = contents(here);
    let is_output = |name: &Path| {
        let name = name.to_string_lossy();
        name.starts_with('x') || name.starts_with("new")
    };
    if code == Some(0) {
        after.retain(|name, _| before.contains_key(name) || !is_output(name));
    }
    if after != *before {
        let names = before.keys().chain(after.keys());
        let changed: Vec<_> = names.filter(|name| before.get(*name) != after.get(*name)).collect();
        faults.push(format!("touched {changed:?}"));
    }
    for entry in fs::read_dir(here).expect("a folder").flatten() {
        if !before.contains_key(Path::new(&entry.file_name())) {
            let path = entry.path();
            fs::remove_file(&path).or_else(|_| fs::remove_dir_all(&path)).expect("removable");
        }
    }
    faults.into_iter().map(|fault| format!("{line}\n    {fault}: {said}")).collect()
}

/// Asserts that `faults_of` finds none in any line; every so many lines share a folder.
fn assert_all<T: Sync>(
    lines: &[T],
    faults_of: impl Fn(&Path, &T, &BTreeMap<PathBuf, Vec<u8>>) -> Vec<String> + Sync,
) {
    let found: Vec<String> = std::thread::scope(|scope| {
        let faults_of = &faults_of;
        let work = |start: usize| {
            move || -> Vec<String> {
                let folder = folder();
                fill(folder.path());
                let before = contents(folder.path());
                let own = lines.iter().skip(start).step_by(FOLDERS);
                own.flat_map(|line| faults_of(folder.path(), line, &before)).collect()
            }
        };
        let threads: Vec<_> = (0..FOLDERS).map(|start| scope.spawn(work(start))).collect();
        threads.into_iter().flat_map(|thread| thread.join().expect("no panic")).collect()
    });
    assert!(found.is_empty(), "{} faults:\n{}", found.len(), found.join("\n"));
}

#[test]
fn mistaken_lines_end_as_documented_and_touch_nothing() {
    let lines: Vec<&str> = LINES.lines().filter(|line| !line.starts_with('#')).collect();
    assert!(lines.len() >= 200);
    assert_all(&lines, |here, line, before| {
        let parts: Vec<&str> = line.splitn(3, '|').map(str::trim).collect();
        let [codes, arguments, words] = parts[..] else { return vec![format!("{line}: no line")] };
        let arguments: Vec<&str> =
            arguments.split(' ').map(|word| if word == "''" { "" } else { word }).collect();
        faults(here, line, || run(here, &arguments), (codes, words), before)
    });
}

/// Lines of a shell, in which `$B` is the program: exit codes, line, words.
const SHELL: &[(&str, &str, &str)] = &[
    ("0", "$B inspect a.mipvog >&-", ""),
    ("0", "$B inspect a.mipvog 2>&-", ""),
    ("5", "$B inspect nothing >&- 2>&-", ""),
    ("0", "$B bake s/fine_last.tar -o x.mipvog <&- >&- 2>&-", ""),
    ("0", "$B man >&-", ""),
    ("0", "$B --help >&-", ""),
    ("0", "$B inspect a.mipvog 2> /dev/full", ""),
    ("5", "$B inspect a.mipvog > /dev/full", "No space left"),
    ("5", "$B validate a.mipvog --format json > /dev/full", "No space left"),
    ("5", "$B man > /dev/full", "No space left"),
    ("5", "$B completions bash > /dev/full", "No space left"),
    ("5", "$B version > /dev/full", "No space left"),
    ("5", "$B view a.mipvog --no-open > /dev/full", "No space left"),
    ("5", "$B bake s/fine_last.tar -o - > /dev/full", "No space left"),
    ("5", "$B unpack b.mipvog -o - > /dev/full", "No space left"),
    ("0", "set -o pipefail; $B man | head -1", ""),
    ("0", "set -o pipefail; $B unpack a.mipvog -o - | head -c 10", ""),
    ("0", "set -o pipefail; $B completions bash | true", ""),
    ("0", "$B bake - -o x.mipvog < s/fine_last.tar", ""),
    ("3", "$B bake - -o x.mipvog <&-", "standard input"),
    ("5", "$B bake - -o x.mipvog < s", "standard input"),
    (
        "3",
        "mkdir x; TMPDIR=$PWD/x $B bake - -o new.mipvog < /dev/zero; code=$?; rmdir x; exit $code",
        "standard input",
    ),
    ("0", "$B transcode - -o - < b.mipvog > x.mipvog", ""),
    ("7", "$B transcode b.mipvog -o ./b.mipvog --force --bits 6", "is also an input"),
    ("0", "$B compare - - --turntable 1 --size 8 --scales 1 < a.mipvog", ""),
    ("0", "env -i $B bake s/fine_last.tar -o x.mipvog", ""),
    ("0", "TMPDIR=/nonexistent $B bake s/fine_last.tar -o x.mipvog --memory 20MB", ""),
    ("5", "TMPDIR=/nonexistent $B bake - -o x.mipvog < s/fine_last.tar", "/nonexistent"),
    ("5", "TMPDIR=/nonexistent $B unpack b.mipvog -o -", "/nonexistent"),
    ("5", "ulimit -f 1; $B bake s/fine_last.tar -o new/deep/x.mipvog", "too large"),
    ("5", "ulimit -f 1; $B unpack a.mipvog -o new/x.safetensors", "too large"),
    ("5", "ulimit -f 1; $B unpack a.mipvog -o new/x/", "too large"),
    (
        "5",
        "ulimit -f 1; e=$($B unpack a.mipvog -o new/x.npz 2>&1); code=$?; [[ $e == *ZipWriter* ]] && exit 99; echo \"$e\" >&2; exit $code",
        "too large",
    ),
    ("5", "ulimit -f 0; $B render a.mipvog -o new/x --size 8", "too large"),
    ("5", "ulimit -f 0; $B render a.mipvog -o new/x.gif --turntable 2 --size 8", "too large"),
    ("5", "ulimit -f 0; $B render a.mipvog -o new/x.webp --turntable 2 --size 8", "too large"),
    (
        "5",
        "ulimit -f 0; $B sweep s/fine_last.tar --turntable 1 --size 8 --scales 1 --bits 8 --repeat 1 -o new/x",
        "too large",
    ),
    ("5", "ulimit -f 0; $B attach room.glb a.mipvog -o new/x.glb", "too large"),
    ("5", "ulimit -f 0; $B detach em.glb -o new/x.glb", "too large"),
    (
        "5",
        "ulimit -f 0; $B compare a.mipvog a.mipvog --turntable 1 --size 8 --scales 1 -o new/x",
        "too large",
    ),
    ("5", "ulimit -f 0; $B transcode a.mipvog -o new/x.mipvog --bits 6", "too large"),
    (
        "5",
        "ulimit -f 0; $B bake s/fine_last.tar -o new/x.mipvog --gltf new/x.glb --depfile new/d",
        "too large",
    ),
    ("5", "ulimit -n 5; $B bake s/fine_last.tar -o x.mipvog", ""),
    ("5", "ulimit -v 300000; $B bake tiny.tar -o new/x.mipvog --threads 256", "threads"),
    (
        "0",
        "$B bake tiny.tar -o x.mipvog -q --force & $B bake tiny.tar -o x.mipvog -q --force; wait $!",
        "",
    ),
    ("0", "cp a.mipvog x$'\\xff'; $B inspect x$'\\xff'", ""),
    ("0", "$B render a.mipvog -o x$'\\xff/' --size 8", ""),
    ("0", "$B unpack b.mipvog -o x$'\\xff.safetensors'", ""),
    (
        "2",
        "$B bake s/fine_last.tar -o x$'\\xff.mipvog' --gltf x$'\\xff.gltf' --depfile x$'\\xff.d'",
        "relative URI",
    ),
    ("2", "$B $'\\xff'", ""),
    ("2", "$B inspect a.mipvog --limit $'\\xff'", ""),
    ("5", "$B inspect -- -x", "-x"),
    (
        "5",
        "n=$(printf 'a%.0s' {1..300}); $B bake s/fine_last.tar -o new/$n.mipvog",
        "name too long",
    ),
    ("5", "n=$(printf 'a%.0s' {1..300}); $B render a.mipvog --size 8 -o new/$n", "name too long"),
    ("5", "n=$(printf 'a/%.0s' {1..3000}); $B render a.mipvog --size 8 -o $n", "name too long"),
    (
        "5",
        "n=$(printf 'a/%.0s' {1..3000}); $B bake s/fine_last.tar -o ${n}x.mipvog",
        "name too long",
    ),
    ("2", "$B bake s/fine_last.tar -o new/x.mipvog --depfile new/../new/x.mipvog", "two outputs"),
    (
        "7",
        "echo 'stepsize = 1' > x.toml; $B bake s/fine_last.tar -o x.mipvog --depfile x.toml; code=$?; rm x.toml; exit $code",
        "exists already",
    ),
    (
        "0",
        "$B bake s/fine_last.tar -o x.mipvog --depfile x.d && $B bake s/fine_last.tar -o x.mipvog --if-changed --depfile x.d",
        "",
    ),
    (
        "5",
        "sed 's/b.mipvog/fifo/' f.gltf > x.gltf; $B inspect x.gltf; code=$?; rm x.gltf; exit $code",
        "fifo",
    ),
    ("3", "$B inspect /proc/version", "an empty file"),
    ("0", "$B inspect /dev/stdin < a.mipvog", ""),
];

#[test]
fn streams_limits_and_odd_names_are_no_way_to_harm() {
    assert_all(SHELL, |here, (codes, line, words), before| {
        let shell = || {
            let mut command = Command::new("bash");
            command.env_clear().env("B", env!("CARGO_BIN_EXE_mipvog-bake"));
            command.env("PATH", std::env::var_os("PATH").unwrap_or_default());
            command.args(["-c", line]).current_dir(here).stdin(Stdio::null());
            command.output().expect("bash is there")
        };
        faults(here, line, shell, (codes, words), before)
    });
}
