//! Runs that are killed, disks that are full, files that go away: no half file under a final name,
//! nothing left behind after the next run, exit codes and messages that name the fault.

use crate::common;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use crate::common::asset::glb;
use crate::common::{fixture, folder, program};
use crate::paused::Paused;
use mipvog::base::bytes;
use mipvog::base::error::ErrorKind;
use mipvog::base::limits::Limits;

const PROGRAM: &str = env!("CARGO_BIN_EXE_mipvog-bake");
/// Verbs, and the points at which each is killed.
const KILLED: [(&str, &[&str]); 6] = [
    (
        "bake SCENE -o x.mipvog --gltf x.glb --fallback-triangles 300 --force",
        &["created 2", "synced 2", "renamed 1", "renamed 2"],
    ),
    ("unpack BAKED -o x.safetensors --force", &["appended 2", "synced 1"]),
    ("unpack BAKED -o x/ --levels 1,2 --force", &["created 3", "renamed 2"]),
    ("attach ROOM BAKED -o x.glb --force", &["appended 1", "synced 1"]),
    (
        "render BAKED --turntable 2 --size 48x32 --scales 1,2 --exr -o x --force",
        &["appended 3", "renamed 5"],
    ),
    (
        "sweep SCENE --turntable 1 --size 24x16 --bits 8,6 --repeat 1 -o x",
        &["appended 2", "renamed 2", "created 2"],
    ),
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
    let [whole, other] = wholes(here);
    let path = here.join("x.mipvog");
    for (point, has_name) in [
        ("created 1", false),
        ("appended 1", false),
        ("appended 9", false),
        ("synced 1", false),
        ("renamed 1", true),
    ] {
        for before in [None, Some(&other)] {
            std::fs::remove_file(&path).ok();
            before.iter().for_each(|bytes| std::fs::write(&path, bytes).expect("own"));
            Paused::at(&mut bake(here, "8"), point).kill();
            let now = std::fs::read(&path).ok();
            assert!(now.as_ref() == if has_name { Some(&whole) } else { before }, "{point}");
            // That of this run alone: it has removed what the last one left.
            let left = names(here).iter().filter(|name| name.ends_with(".partial")).count();
            assert_eq!(left, usize::from(!has_name), "{point}");
        }
    }
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
    for (line, points) in KILLED {
        let folder = folder();
        let here = folder.path();
        let run = || {
            let words = line.split(' ').map(|word| match word {
                "SCENE" => scene(),
                "BAKED" => fixture("baked/tiny.rate.mipvog").into(),
                "ROOM" => room.clone().into(),
                word => word.into(),
            });
            let mut command = program();
            command.current_dir(here).args(words);
            command
        };
        assert!(quiet(&mut run()).wait().expect("ends").success(), "{line}");
        let wholes = contents(here);
        let is_sweep = line.starts_with("sweep");
        for (number, point) in points.iter().enumerate() {
            // A sweep goes on from its last result, at first from the start; other runs find files of
            // another run.
            if !is_sweep {
                wholes
                    .keys()
                    .for_each(|name| std::fs::write(here.join(name), "mine").expect("own"));
            } else if number == 0 {
                std::fs::remove_dir_all(here.join("x")).expect("own");
            }
            Paused::at(&mut run(), point).kill();
            for (name, bytes) in contents(here) {
                if name.to_string_lossy().ends_with(".partial") {
                    continue;
                }
                let whole = wholes.get(&name).unwrap_or_else(|| panic!("{line}: {name:?}"));
                let good = bytes == b"mine" || is_whole(&name, &bytes, whole);
                assert!(good, "{line}: {name:?} is half at {point}");
            }
        }
        assert!(quiet(&mut run()).wait().expect("ends").success(), "{line}");
        assert!(contents(here).keys().eq(wholes.keys()), "{line}: {:?}", contents(here).keys());
    }
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
        mipvog_inputs::open_with(&input, &Default::default(), &Limits::default()).expect("a scene");
    let file = std::fs::File::options().write(true).open(&input).expect("own");
    file.set_len(40_000).expect("own");
    let error = common::baked_bytes(&opened.field, &Default::default()).expect_err("too short");
    assert!(matches!(error.kind(), ErrorKind::Truncated { .. }), "{error}");
    // An open file outlives its name.
    std::fs::copy(scene(), &input).expect("copied");
    let opened =
        mipvog_inputs::open_with(&input, &Default::default(), &Limits::default()).expect("a scene");
    std::fs::remove_file(&input).expect("own");
    common::baked_bytes(&opened.field, &Default::default()).expect("the bytes are there");
    // At named moments, as the user sees it.
    let [whole, _] = wholes(here);
    for point in ["created 1", "appended 1", "appended 9"] {
        for length in [None, Some(0), Some(10_000), Some(39_000)] {
            std::fs::copy(scene(), &input).expect("copied");
            std::fs::remove_file(here.join("x.mipvog")).ok();
            let mut command = program();
            command.current_dir(here).args(["bake", "-o", "x.mipvog", "--threads", "1"]);
            let run = Paused::at(command.arg("scene.tar"), point);
            match length {
                None => std::fs::remove_file(&input).expect("own"),
                Some(length) => {
                    let file = std::fs::File::options().write(true).open(&input).expect("own");
                    file.set_len(length).expect("own");
                }
            }
            let (code, said) = run.go_on();
            let now = std::fs::read(here.join("x.mipvog")).ok();
            match code {
                Some(0) => assert!(now.as_ref() == Some(&whole)),
                code => {
                    assert!([Some(3), Some(5)].contains(&code), "{code:?}: {said}");
                    assert!(said.contains("scene.tar") && said.contains("help:"), "{said}");
                    assert!(now.is_none());
                }
            }
            assert!(names(here).iter().all(|name| !name.ends_with(".partial")));
        }
    }
}

#[test]
fn signals_end_a_run_with_their_code_and_leave_nothing() {
    let folder = folder();
    let here = folder.path();
    for (signal, code) in [("-INT", 130), ("-TERM", 143)] {
        let (ended, said) = Paused::at(&mut bake(here, "8"), "created 1").signal(signal);
        assert_eq!(ended, Some(code), "{signal}: {said}");
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
