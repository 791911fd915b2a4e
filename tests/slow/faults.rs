//! Runs that are killed, disks that are full, files that go away: no half file under a final name,
//! nothing left behind after the next run, exit codes and messages that name the fault.

use crate::common;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io::Read;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::Instant;

use crate::common::asset::glb;
use crate::common::{Random, fixture, folder, program};
use mipvog_bake::unstable::base::bytes;
use mipvog_bake::unstable::base::error::ErrorKind;
use mipvog_bake::unstable::base::limits::Limits;
use mipvog_bake::unstable::input;

const PROGRAM: &str = env!("CARGO_BIN_EXE_mipvog-bake");
/// Kills of bakes.
const KILLS: usize = 200;
/// Other verbs and how often each is killed.
const KILLED: [(&str, usize); 6] = [
    ("bake SCENE -o x.mipvog --gltf x.glb --fallback-triangles 300 --force", 30),
    ("unpack BAKED -o x.safetensors --force", 40),
    ("unpack BAKED -o x/ --levels 1,2 --force", 20),
    ("attach ROOM BAKED -o x.glb --force", 40),
    ("render BAKED --turntable 2 --size 48x32 --scales 1,2 --exr -o x --force", 20),
    ("sweep SCENE --turntable 1 --size 24x16 --bits 8,6 --repeat 1 -o x", 30),
];

fn scene() -> OsString {
    fixture("trained/tiny/fine_last.tar").into()
}

fn bake(folder: &Path, bits: &str) -> Command {
    let mut command = program();
    command.current_dir(folder).stdin(Stdio::null());
    command.args(["bake", "-o", "x.mipvog", "--force", "--threads", "1", "--bits", bits]);
    command.arg(scene());
    command
}

fn quiet(command: &mut Command) -> Child {
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("starts")
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder").flatten();
    let mut names: Vec<_> =
        entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// The bytes of whole runs with 8 and with 6 bits.
fn wholes(folder: &Path) -> [Vec<u8>; 2] {
    ["8", "6"].map(|bits| {
        assert!(quiet(&mut bake(folder, bits)).wait().expect("ends").success());
        std::fs::read(folder.join("x.mipvog")).expect("written")
    })
}

fn failed(output: &Output, code: i32, says: &[&str]) {
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{message}");
    for part in says {
        assert!(message.contains(part), "no {part:?} in {message}");
    }
}

#[test]
fn a_killed_run_leaves_no_half_file_and_the_next_one_cleans_up() {
    let folder = folder();
    let here = folder.path();
    let clock = Instant::now();
    let wholes = wholes(here);
    let time = clock.elapsed() / 2;
    let mut random = Random::new(4);
    let (mut killed, mut left) = (0, 0);
    for run in 0..KILLS {
        // Sometimes there is a file before, sometimes not.
        if run % 3 == 0 {
            std::fs::remove_file(here.join("x.mipvog")).ok();
        }
        let before = std::fs::read(here.join("x.mipvog")).ok();
        let mut child = quiet(&mut bake(here, ["8", "6"][run % 2]));
        std::thread::sleep(time.mul_f32(random.between(0.0, 1.1)));
        child.kill().expect("a child");
        killed += usize::from(child.wait().expect("ends").signal() == Some(9));
        let now = std::fs::read(here.join("x.mipvog")).ok();
        let whole = now.as_ref() == Some(&wholes[run % 2]);
        assert!(whole || now == before, "run {run} left something half");
        left += names(here).len() - usize::from(now.is_some());
    }
    assert!(killed > KILLS / 4, "only {killed} runs were still there to be killed");
    assert!(left > 0, "no run was killed while it wrote");
    assert!(quiet(&mut bake(here, "8")).wait().expect("ends").success());
    assert_eq!(names(here), ["x.mipvog"]);
}

/// Every file in a folder and those below it, by its name from there.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for name in names(folder).into_iter().map(PathBuf::from) {
        let path = folder.join(&name);
        if path.is_dir() {
            found.extend(contents(&path).into_iter().map(|(below, b)| (name.join(below), b)));
        } else {
            found.insert(name, std::fs::read(path).expect("a file"));
        }
    }
    found
}

/// True if an output is the one of an undisturbed run, but for the seconds that reports of a sweep
/// hold.
fn is_whole(name: &Path, bytes: &[u8], whole: &[u8]) -> bool {
    let count = |bytes: &[u8], what| bytes.iter().filter(|&&byte| byte == what).count();
    match name.extension().and_then(|extension| extension.to_str()) {
        Some("json") => serde_json::from_slice::<serde_json::Value>(bytes).is_ok(),
        Some("html") => bytes.ends_with(b"</html>\n"),
        Some("csv") => [b'\n', b','].iter().all(|&c| count(bytes, c) == count(whole, c)),
        _ => bytes == whole,
    }
}

#[test]
fn killed_verbs_leave_nothing_half_and_the_next_run_cleans_up() {
    let inputs = folder();
    let room = inputs.path().join("room.glb");
    std::fs::write(&room, glb("{\"asset\":{\"version\":\"2.0\"}}", &[])).expect("writable");
    let mut random = Random::new(5);
    let mut interrupted = 0;
    for (line, kills) in KILLED {
        let folder = folder();
        let here = folder.path();
        let run = || {
            let words = line.split(' ').map(|word| match word {
                "SCENE" => scene(),
                "BAKED" => fixture("baked/tiny.rate.mipvog").into(),
                "ROOM" => room.clone().into(),
                word => word.into(),
            });
            quiet(program().current_dir(here).stdin(Stdio::null()).args(words))
        };
        let clock = Instant::now();
        assert!(run().wait().expect("ends").success(), "{line}");
        let time = clock.elapsed();
        let wholes = contents(here);
        let is_sweep = line.starts_with("sweep");
        for number in 0..kills {
            // A sweep goes on from its last result, now and then from the start; other runs find
            // files of another run.
            if !is_sweep {
                wholes
                    .keys()
                    .for_each(|name| std::fs::write(here.join(name), "mine").expect("own"));
            } else if number % 3 == 0 {
                std::fs::remove_dir_all(here.join("x")).expect("own");
            }
            let mut child = run();
            std::thread::sleep(time.mul_f32(random.between(0.0, 1.1)));
            child.kill().expect("a child");
            interrupted += usize::from(child.wait().expect("ends").signal() == Some(9));
            for (name, bytes) in contents(here) {
                if name.to_string_lossy().ends_with(".partial") {
                    continue;
                }
                let whole = wholes.get(&name).unwrap_or_else(|| panic!("{line}: {name:?}"));
                let good = bytes == b"mine" || is_whole(&name, &bytes, whole);
                assert!(good, "{line}: run {number} left {name:?} half");
            }
        }
        assert!(run().wait().expect("ends").success(), "{line}");
        assert!(contents(here).keys().eq(wholes.keys()), "{line}: {:?}", contents(here).keys());
    }
    assert!(interrupted > 45, "only {interrupted} runs were still there to be killed");
}

#[test]
fn what_others_write_stays_and_what_nobody_writes_goes() {
    let folder = folder();
    let here = folder.path();
    let mut own = bytes::Output::create(&here.join("own.bin"), false).expect("writable");
    bytes::ByteSink::append(&mut own, b"mine").expect("written");
    std::fs::write(here.join(".mipvog-123456.partial"), b"half").expect("written");
    std::fs::write(here.join(".mipvog-notes"), b"a user's").expect("written");
    std::fs::create_dir(here.join(".mipvog-folder.partial")).expect("written");
    let written = own.written().to_owned();
    assert!(quiet(&mut bake(here, "8")).wait().expect("ends").success());
    assert!(written.exists());
    own.finish().expect("still there");
    assert_eq!(std::fs::read(here.join("own.bin")).expect("written"), b"mine");
    let expected = [".mipvog-folder.partial", ".mipvog-notes", "own.bin", "x.mipvog"];
    assert_eq!(names(here), expected);
}

#[test]
fn of_two_runs_with_one_output_one_wins_whole() {
    let folder = folder();
    let here = folder.path();
    let wholes = wholes(here);
    for forced in [true, false, true, false] {
        std::fs::remove_file(here.join("x.mipvog")).ok();
        let children = ["8", "6", "8", "6"].map(|bits| {
            let mut command = bake(here, bits);
            if !forced {
                command = program();
                command.current_dir(here).args(["bake", "-o", "x.mipvog", "--bits", bits]);
                command.arg(scene());
            }
            quiet(&mut command)
        });
        let codes = children.map(|mut child| child.wait().expect("ends").code());
        let won = codes.iter().filter(|code| **code == Some(0)).count();
        let lost = codes.iter().filter(|code| **code == Some(7)).count();
        assert_eq!((won, lost), if forced { (4, 0) } else { (1, 3) }, "{codes:?}");
        let now = std::fs::read(here.join("x.mipvog")).expect("written");
        assert!(wholes.contains(&now));
        assert_eq!(names(here), ["x.mipvog"]);
    }
}

#[test]
fn a_full_disk_is_told_and_leaves_nothing() {
    let folder = folder();
    let here = folder.path();
    // The shell's limit on file sizes, in blocks of 512 or 1024 bytes.
    let limited = |arguments: &str| {
        let script = format!("ulimit -f 8; exec \"$0\" {arguments}");
        let mut command = Command::new("sh");
        command.current_dir(here).args(["-c", &script, PROGRAM]).arg(scene());
        command.output().expect("starts")
    };
    let output = limited("bake -o x.mipvog \"$1\"");
    failed(&output, 5, &["x.mipvog", "help: raise the quota"]);
    assert_eq!(names(here), [""; 0]);
    // The file that was there stays.
    std::fs::write(here.join("x.mipvog"), b"mine").expect("writable");
    failed(&limited("bake -o x.mipvog --force \"$1\""), 5, &["x.mipvog"]);
    assert_eq!(std::fs::read(here.join("x.mipvog")).expect("there"), b"mine");
    assert_eq!(names(here), ["x.mipvog"]);
    // Reports too: a device that is always full.
    if Path::new("/dev/full").exists() {
        let full = std::fs::File::options().write(true).open("/dev/full").expect("a device");
        let mut command = Command::new(PROGRAM);
        let inspect = command.arg("inspect").arg(scene()).stdout(full);
        failed(&inspect.output().expect("starts"), 5, &["stdout", "help: free some space"]);
    }
}

/// A temporary folder whose parents every user may enter.
fn folder_for_all() -> tempfile::TempDir {
    let folder = folder();
    let is_open = |parent: &Path| {
        let metadata = std::fs::metadata(parent).expect("a folder");
        metadata.permissions().mode() & 0o001 != 0
    };
    match folder.path().ancestors().skip(1).all(is_open) {
        true => folder,
        false => tempfile::tempdir().expect("a temporary folder"),
    }
}

#[test]
fn a_folder_that_cannot_be_written_is_told() {
    let folder = folder_for_all();
    let here = folder.path();
    let closed = here.join("closed");
    std::fs::create_dir(&closed).expect("writable");
    let mode = |path: &Path, mode| {
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).expect("own");
    };
    let (program, input) = (here.join("program"), here.join("scene"));
    let linked = std::fs::hard_link(PROGRAM, &program);
    linked.or_else(|_| std::fs::copy(PROGRAM, &program).map(drop)).expect("copied");
    std::fs::copy(scene(), &input).expect("copied");
    mode(here, 0o755);
    mode(&closed, 0o555);
    let command = |user: Option<u32>| {
        let mut command = Command::new(&program);
        command.args(["bake", "-o"]).arg(closed.join("x.mipvog")).arg(&input).current_dir("/");
        user.map(|user| command.uid(user).gid(user));
        command.output().expect("starts")
    };
    let mut output = command(None);
    // No folder is closed to root; another user is asked then.
    if output.status.success() {
        std::fs::remove_file(closed.join("x.mipvog")).expect("written by root");
        output = command(Some(65534));
    }
    failed(&output, 5, &["closed/x.mipvog", "help: check the permissions"]);
    assert_eq!(names(&closed), [""; 0]);
    mode(&closed, 0o755);
}

#[test]
fn an_input_that_shrinks_or_goes_is_an_error_or_was_read() {
    let folder = folder();
    let here = folder.path();
    let input = here.join("scene.tar");
    // In the middle of a bake, as the library sees it.
    std::fs::copy(scene(), &input).expect("copied");
    let opened =
        input::open_with(&input, &Default::default(), &Limits::default()).expect("a scene");
    let file = std::fs::File::options().write(true).open(&input).expect("own");
    file.set_len(40_000).expect("own");
    let error = common::baked_bytes(&opened.field, &Default::default()).expect_err("too short");
    assert!(matches!(error.kind(), ErrorKind::Truncated { .. }), "{error}");
    // An open file outlives its name.
    std::fs::copy(scene(), &input).expect("copied");
    let opened =
        input::open_with(&input, &Default::default(), &Limits::default()).expect("a scene");
    std::fs::remove_file(&input).expect("own");
    common::baked_bytes(&opened.field, &Default::default()).expect("the bytes are there");
    // At any moment, as the user sees it.
    let clock = Instant::now();
    let [whole, _] = wholes(here);
    let time = clock.elapsed() / 2;
    let mut random = Random::new(6);
    for run in 0..20 {
        std::fs::copy(scene(), &input).expect("copied");
        std::fs::remove_file(here.join("x.mipvog")).ok();
        let mut command = Command::new(PROGRAM);
        command.current_dir(here).args(["bake", "-o", "x.mipvog", "--threads", "1", "scene.tar"]);
        let child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("starts");
        std::thread::sleep(time.mul_f32(random.between(0.0, 1.0)));
        if run % 4 == 0 {
            std::fs::remove_file(&input).expect("own");
        } else {
            let file = std::fs::File::options().write(true).open(&input).expect("own");
            file.set_len(random.below(40_000) as u64).expect("own");
        }
        let output = child.wait_with_output().expect("ends");
        match output.status.code() {
            Some(0) => assert!(std::fs::read(here.join("x.mipvog")).expect("written") == whole),
            code => {
                failed(&output, code.expect("no signal"), &["scene.tar", "help:"]);
                assert!([Some(3), Some(5)].contains(&code), "{code:?}");
                assert!(!here.join("x.mipvog").exists());
            }
        }
        assert!(names(here).iter().all(|name| !name.ends_with(".partial")));
    }
}

#[test]
fn signals_end_a_run_with_their_code_and_leave_nothing() {
    let folder = folder();
    let here = folder.path();
    for (signal, code) in [("INT", 130), ("TERM", 143)] {
        let mut command = bake(here, "8");
        command.args(["--filter", "none", "--zstd-level", "22", "--levels", "1", "--verbose"]);
        let mut child =
            command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("starts");
        // It watches for signals by the time of its warning about missing settings.
        let mut byte = [0];
        child.stderr.as_mut().expect("a pipe").read_exact(&mut byte).expect("a warning");
        common::send(&format!("-{signal}"), child.id());
        let ended = child.wait().expect("ends").code();
        // It may have been done before.
        let done = ended == Some(0) && here.join("x.mipvog").exists();
        assert!(done || ended == Some(code), "{signal}: {ended:?}");
        std::fs::remove_file(here.join("x.mipvog")).ok();
        assert_eq!(names(here), [""; 0]);
    }
}

#[test]
fn a_closed_pipe_is_no_error() {
    for format in ["text", "json"] {
        let mut command = Command::new(PROGRAM);
        let inspect = command.arg("inspect").arg(scene()).args(["--format", format]);
        let mut child =
            inspect.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("starts");
        drop(child.stdout.take());
        let output = child.wait_with_output().expect("ends");
        assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    }
}

#[test]
fn outputs_are_locked_while_they_are_written() {
    let folder = folder();
    let output = bytes::Output::create(&folder.path().join("x"), false).expect("writable");
    let other = std::fs::File::open(output.written()).expect("there");
    assert!(other.try_lock().is_err());
    drop(output);
    assert!(other.try_lock().is_ok());
}
