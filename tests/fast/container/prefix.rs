//! Containers that are cut at the end of a level: the reader of prefixes shows the whole levels,
//! the strict reader refuses them.

use std::path::Path;
use std::sync::Arc;

use crate::common::{fixture, open_bytes};
use mipvog::base::bytes::SourceFile;
use mipvog::base::error::{ErrorKind, Result};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::container::{Container, Prefix};
use mipvog::model::camera::turntable;
use mipvog::view::render::{FrameOptions, LevelChoice, Renderer, render};

fn read_prefix(bytes: &[u8]) -> Result<Prefix> {
    let file = SourceFile::decoded(bytes.to_vec(), Path::new("cut.mipvog"));
    Container::read_prefix(Arc::new(file), &Limits::default())
}

/// Files with raw levels, with inherited blocks, with a mask and with colour alone on coarser
/// levels.
const FILES: [&str; 4] =
    ["tiny.paper.mipvog", "tiny.rate.filled.mipvog", "dvgo.mask.mipvog", "tiny.code.mipvog"];

#[test]
fn every_prefix_that_ends_at_a_level_opens_and_no_other_does() {
    for name in FILES {
        let bytes = std::fs::read(fixture("baked").join(name)).expect("a container");
        let whole = open_bytes(&bytes).expect("valid");
        let all = whole.read().expect("decodes");
        let prefix_of = |level: usize| {
            let mut entries = whole.entries().iter();
            let found = entries.find(|entry| entry.level == Some(level as u32));
            found.expect("a chunk of the level").prefix as usize
        };
        let ends: Vec<usize> = (0..all.levels.len()).map(prefix_of).collect();
        for &end in &ends {
            let finest = ends.iter().position(|&other| other == end).expect("this one");
            let prefix = read_prefix(&bytes[..end]).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert_eq!(prefix.missing(), 0..finest);
            assert_eq!(prefix.metadata(), whole.metadata());
            let read = prefix.read().expect("what is there decodes");
            assert_eq!(read.finest, finest);
            assert_eq!(read.levels[finest..], all.levels[finest..]);
            assert!(read.levels[..finest].iter().all(|level| level.table.frames() == 0));
            assert_eq!((&read.view_mlp, &read.free_space), (&all.view_mlp, &all.free_space));
            if finest > 0 {
                assert!(open_bytes(&bytes[..end]).is_err(), "{name}: the strict reader");
            }
        }
        let step = (bytes.len() / 400).max(1);
        for end in (0..bytes.len()).step_by(step).filter(|end| !ends.contains(end)) {
            let error = read_prefix(&bytes[..end]).expect_err("within a level");
            assert!(matches!(error.kind(), ErrorKind::Truncated { .. }), "{name} {end}: {error}");
        }
        let longer = [&bytes[..], &[0; 64]].concat();
        assert!(read_prefix(&longer).is_err());
    }
}

#[test]
fn damage_in_a_prefix_is_found() {
    let bytes = std::fs::read(fixture("baked").join("tiny.paper.mipvog")).expect("a container");
    let whole = open_bytes(&bytes).expect("valid");
    let coarsest = whole.entries().iter().filter(|entry| entry.level.is_some());
    let end = coarsest.map(|entry| entry.prefix).min().expect("levels") as usize;
    for at in 0..end {
        let mut damaged = bytes[..end].to_vec();
        damaged[at] ^= 1;
        let read = read_prefix(&damaged).and_then(|prefix| prefix.read());
        assert!(read.is_err(), "byte {at}");
    }
}

#[test]
fn pictures_of_a_prefix_are_those_of_the_whole_file_without_its_finer_levels() {
    for name in ["tiny.paper.mipvog", "tiny.rate.filled.mipvog"] {
        let bytes = std::fs::read(fixture("baked").join(name)).expect("a container");
        let whole = open_bytes(&bytes).expect("valid");
        let baked = whole.read().expect("decodes");
        for entry in whole.entries().iter().filter(|entry| entry.kind == *b"TABL") {
            let prefix = read_prefix(&bytes[..entry.prefix as usize]).expect("a prefix");
            let cut = Renderer::baked(&prefix.read().expect("decodes"), &Limits::default());
            let cut = cut.expect("a field");
            let mut field = Renderer::baked(&baked, &Limits::default()).expect("a field");
            field.view_mut().finest = prefix.missing().end;
            for camera in turntable(&baked.metadata.bounds, 3, [31, 23]) {
                for levels in [LevelChoice::Auto, LevelChoice::Fixed(0), LevelChoice::Fixed(2)] {
                    let options = FrameOptions { levels, supersample: 1 };
                    let frame = |field| render(field, &camera, &options, &Silent).expect("a frame");
                    let (got, want) = (frame(&cut), frame(&field));
                    assert_eq!(got.color, want.color, "{name} {:?} {levels:?}", entry.level);
                }
            }
        }
    }
}
