//! Verbs as functions of a program that holds the library: reports, failures, bytes that are no
//! file, and a watcher.

use std::ffi::OsString;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use crate::common::{fixture, folder};
use mipvog::base::bytes::{ReadAt, SourceFile};
use mipvog_bake::cli::{Call, SharedWatcher, Watcher, call, option_names};

/// The bytes of a file, as a program holds them.
#[derive(Debug)]
struct Bytes(Vec<u8>);

impl ReadAt for Bytes {
    fn length(&self) -> std::io::Result<u64> {
        Ok(self.0.len() as u64)
    }

    fn read_at(&self, offset: u64, out: &mut [u8]) -> std::io::Result<()> {
        out.copy_from_slice(&self.0[offset as usize..][..out.len()]);
        Ok(())
    }
}

#[derive(Default)]
struct Log {
    shares: Mutex<Vec<f64>>,
    ends: AtomicBool,
}

impl Watcher for Log {
    fn shows(&self, step: &str, share: f64) {
        assert!(!step.is_empty());
        self.shares.lock().expect("no panic").push(share);
    }

    fn ends(&self) -> bool {
        self.ends.load(Ordering::Relaxed)
    }
}

fn words(words: &[&dyn AsRef<Path>]) -> Vec<OsString> {
    words.iter().map(|word| word.as_ref().as_os_str().to_owned()).collect()
}

#[test]
fn bytes_that_are_no_file_bake_as_the_file_does() {
    let folder = folder();
    let trained = fixture("trained").join("tiny/fine_last.tar");
    let [file, held] = ["file.mipvog", "held.mipvog"].map(|name| folder.path().join(name));
    let quiet = [&"--quiet" as &dyn AsRef<Path>, &"-o"];
    let arguments = words(&[&"bake", &trained, quiet[0], quiet[1], &file]);
    call(Call { arguments, ..Call::default() }).expect("a bake of the file");
    let bytes = Bytes(std::fs::read(&trained).expect("the fixture"));
    let input =
        Some(Arc::new(SourceFile::held(Arc::new(bytes), Path::new("arrays")).expect("bytes")));
    let log = Arc::new(Log::default());
    let watcher = Some(SharedWatcher(Arc::clone(&log) as _));
    let arguments = words(&[&"bake", &"-", quiet[0], quiet[1], &held]);
    let report =
        call(Call { arguments, input, watcher, ..Call::default() }).expect("a bake of the bytes");
    assert_eq!(report["input"], "arrays");
    let [file, held] = [file, held].map(|path| std::fs::read(path).expect("baked"));
    assert!(file == held, "the same bytes");
    let shares = log.shares.lock().expect("no panic");
    assert!(!shares.is_empty() && shares.is_sorted() && shares.iter().all(|share| *share <= 1.0));
}

#[test]
fn a_watcher_ends_the_work_and_nothing_is_left() {
    let folder = folder();
    let trained = fixture("trained").join("tiny/fine_last.tar");
    let log = Arc::new(Log::default());
    log.ends.store(true, Ordering::Relaxed);
    let output = folder.path().join("a.mipvog");
    let arguments = words(&[&"bake", &trained, &"--quiet", &"-o", &output]);
    let watcher = Some(SharedWatcher(log as _));
    let failure = call(Call { arguments, watcher, ..Call::default() }).expect_err("ended");
    assert_eq!((failure.kind, failure.exit_code), ("cancelled", 130));
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0);
}

#[test]
fn failures_have_their_kind_place_and_code() {
    let folder = folder();
    let missing = folder.path().join("none.tar");
    let output = folder.path().join("a.mipvog");
    let run = |more: &[&dyn AsRef<Path>]| {
        let arguments = words(&[&[&"bake" as &dyn AsRef<Path>, &"-o", &output], more].concat());
        call(Call { arguments, ..Call::default() }).expect_err("it fails")
    };
    let failure = run(&[&missing]);
    assert_eq!((failure.kind, failure.exit_code), ("io", 5));
    assert_eq!(failure.file.as_deref(), missing.to_str());
    let failure = run(&[&missing, &"--bitts", &"8"]);
    assert_eq!((failure.kind, failure.exit_code), ("usage", 2));
    assert!(failure.message.contains("--bitts") && !failure.message.contains("Usage"));
    let trained = fixture("trained").join("tiny/fine_last.tar");
    let failure =
        run(&[&trained, &"--turntable=1", &"--size=16x16", &"--bits=4", &"--require-psnr=150"]);
    assert_eq!((failure.kind, failure.exit_code), ("gate", 1));
    assert_eq!(failure.report.expect("a report")["quality"]["passed"], false);
}

#[test]
fn options_that_can_be_given_again_are_known() {
    let options = option_names("bake");
    let again = |name: &str| options.iter().find(|(own, _)| own == name).map(|(_, again)| *again);
    assert_eq!(again("limit"), Some(true));
    assert_eq!(again("bits"), Some(false));
    assert_eq!(again("frames"), Some(false));
    assert_eq!(again("output"), Some(false));
}
