//! Names of frames, and the pictures that they name.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Extensions of pictures, in the order of the search for names without one.
const EXTENSIONS: [&str; 6] = ["png", "jpg", "jpeg", "webp", "tif", "tiff"];
/// Further extensions that are not part of a frame's name.
const OTHER_EXTENSIONS: [&str; 13] =
    ["bmp", "gif", "exr", "hdr", "heic", "heif", "avif", "jxl", "jp2", "ppm", "pgm", "dng", "npy"];

/// The components of a path, without `.` and `..`. Backslashes separate Windows paths, unless a
/// file has that name.
fn parts<'a>(folder: &Path, path: &'a str) -> Vec<&'a str> {
    let is_name = path.contains('\\') && folder.join(path).is_file();
    let separates = |c: char| c == '/' || c == '\\' && !is_name;
    let path = if is_name { path } else { without_drive(path) };
    path.split(separates).filter(|part| !matches!(*part, "" | "." | "..")).collect()
}

/// A path of Windows without the letter of its drive.
fn without_drive(path: &str) -> &str {
    match path.as_bytes() {
        [letter, b':', b'/' | b'\\', ..] if letter.is_ascii_alphabetic() => &path[2..],
        _ => path,
    }
}

fn is_absolute(path: &str) -> bool {
    path.starts_with(['/', '\\']) || without_drive(path).len() < path.len()
}

/// A file's name without its extension: one of pictures, or one that a file here has. Text behind
/// any other dot is part of the name, as in `scan.0001`.
fn stem<'a>(folder: &Path, path: &str, name: &'a str) -> &'a str {
    let Some((stem, extension)) = name.rsplit_once('.') else { return name };
    let is_picture = |known: &&str| extension.eq_ignore_ascii_case(known);
    let starts_with_letter = extension.starts_with(|c: char| c.is_ascii_alphabetic());
    let is_extension = EXTENSIONS.iter().chain(&OTHER_EXTENSIONS).any(is_picture)
        || starts_with_letter && picture_as_named(folder, path).is_some();
    if stem.is_empty() || !is_extension { name } else { stem }
}

/// The name of a frame, without folder and extension.
fn bare_name(folder: &Path, path: &str) -> Option<String> {
    let name = parts(folder, path).pop()?;
    // A path that ends in `..` names no file.
    let ends_upwards = path.trim_end_matches(['/', '\\']).ends_with("..") && name != "..";
    (!ends_upwards).then(|| stem(folder, path, name).to_owned())
}

/// The names of all frames. If several frames have the same name, like those of two cameras with a
/// folder each, as many folders are prepended as tell them apart, then extensions are appended.
pub(super) fn names(folder: &Path, paths: &[Option<&str>]) -> Vec<String> {
    let bare: Vec<Option<String>> =
        paths.iter().map(|path| path.and_then(|path| bare_name(folder, path))).collect();
    let folders: Vec<Vec<&str>> = paths
        .iter()
        .map(|path| {
            let mut parts = path.map(|path| parts(folder, path)).unwrap_or_default();
            parts.pop();
            parts
        })
        .collect();
    let mut depths = vec![0; paths.len()];
    loop {
        let name = |number: usize| {
            let Some(bare) = &bare[number] else { return format!("frame_{number}") };
            let folders = &folders[number];
            let depth: usize = depths[number];
            let from = folders.len().saturating_sub(depth);
            let last = match depth > folders.len() {
                true => paths[number].and_then(|path| parts(folder, path).pop()).unwrap_or(bare),
                false => bare,
            };
            folders[from..].iter().chain([&last]).copied().collect::<Vec<_>>().join("_")
        };
        let names: Vec<String> = (0..paths.len()).map(name).collect();
        let mut alike: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for (number, name) in names.iter().enumerate() {
            alike.entry(name).or_default().push(number);
        }
        let mut deeper = depths.clone();
        // Duplicates of a frame keep the same name.
        let differ =
            |group: &&Vec<usize>| group.iter().any(|&number| paths[number] != paths[group[0]]);
        for group in alike.values().filter(differ) {
            let has_folders = |&&number: &&usize| depths[number] < folders[number].len();
            // A count beyond the number of folders adds the extension.
            let is_last = |&&number: &&usize| depths[number] == folders[number].len();
            let next = match group.iter().any(|number| has_folders(&number)) {
                true => group.iter().filter(has_folders).collect::<Vec<_>>(),
                false => group.iter().filter(is_last).collect(),
            };
            next.into_iter().for_each(|&number| deeper[number] += 1);
        }
        if deeper == depths {
            return names;
        }
        depths = deeper;
    }
}

/// Path of a frame's picture: as named, or with the extension that NeRF-synthetic files leave out.
/// A path of another machine or of Windows is searched for by its components.
pub fn picture_path(folder: &Path, name: &str) -> Option<PathBuf> {
    picture_as_named(folder, name).or_else(|| {
        let parts = if is_absolute(name) { parts(folder, name) } else { Vec::new() };
        by_last_parts(folder, &parts, 1)
    })
}

fn picture_as_named(folder: &Path, name: &str) -> Option<PathBuf> {
    with_extension(&folder.join(name)).or_else(|| {
        let slashed = name.contains('\\').then(|| name.replace('\\', "/"))?;
        with_extension(&folder.join(slashed))
    })
}

/// A frame's picture in a folder that holds pictures: below it by the frame's path or by the last
/// parts of it, with another extension too, else by the frame's name with any extension of
/// pictures.
pub fn photograph_path(folder: &Path, path: Option<&str>, name: &str) -> Option<PathBuf> {
    let parts = path.map(|path| parts(folder, path)).unwrap_or_default();
    let bare = path.and_then(|path| bare_name(folder, path));
    let in_folders = path
        .and_then(|path| picture_as_named(folder, path))
        .or_else(|| by_last_parts(folder, &parts, 2))
        .or_else(|| {
            // With another extension than the path has.
            let bare = Path::new(path?).with_file_name(bare.as_deref()?);
            picture_as_named(folder, bare.to_str()?)
        });
    // A disambiguated name is more specific than the file name alone.
    let is_bare = bare.as_deref() == Some(name);
    let by_own_name = || (!is_bare).then(|| with_extension(&folder.join(name))).flatten();
    let by_bare_name = || bare.as_ref().and_then(|bare| with_extension(&folder.join(bare)));
    in_folders
        .or_else(by_own_name)
        .or_else(|| by_last_parts(folder, &parts, 1))
        .or_else(by_bare_name)
        .filter(|found| found.is_file())
}

/// The file with the longest matching tail of a path's components, at least `fewest` of them.
fn by_last_parts(folder: &Path, parts: &[&str], fewest: usize) -> Option<PathBuf> {
    let most = parts.len().saturating_sub(fewest);
    let starts = if parts.len() < fewest { 0..0 } else { 0..most + 1 };
    starts.into_iter().find_map(|from| {
        let below: PathBuf = parts[from..].iter().collect();
        with_extension(&folder.join(below))
    })
}

/// The file of this path, or of this path plus an extension of pictures.
fn with_extension(path: &Path) -> Option<PathBuf> {
    if path.is_file() {
        return Some(path.to_owned());
    }
    path.file_name()?;
    let spellings = EXTENSIONS.iter().flat_map(|name| [(*name).to_owned(), name.to_uppercase()]);
    let named = |extension: String| {
        let mut name = path.as_os_str().to_owned();
        name.push(".");
        name.push(extension);
        PathBuf::from(name)
    };
    spellings.map(named).find(|path| path.is_file())
}

/// The index of the frame that a user names: by its name, its path, its bare name if that is
/// unique, or its index.
///
/// # Errors
/// The names of the frames with this bare name.
pub(super) fn find(
    frames: &[(&str, Option<&str>)],
    wanted: &str,
) -> std::result::Result<usize, Vec<String>> {
    let by_name = frames.iter().position(|(name, _)| *name == wanted);
    let by_path = || frames.iter().position(|(_, path)| *path == Some(wanted));
    if let Some(number) = by_name.or_else(by_path) {
        return Ok(number);
    }
    let nowhere = Path::new("");
    let is_bare = |path: &str| bare_name(nowhere, path).is_some_and(|bare| bare == wanted);
    let alike: Vec<usize> =
        (0..frames.len()).filter(|&number| frames[number].1.is_some_and(is_bare)).collect();
    match alike.as_slice() {
        &[one] => Ok(one),
        [] => wanted.parse().ok().filter(|&number| number < frames.len()).ok_or_else(Vec::new),
        several => Err(several.iter().map(|&number| frames[number].0.to_owned()).collect()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(paths: &[&str]) -> Vec<String> {
        let paths: Vec<Option<&str>> = paths.iter().map(|path| Some(*path)).collect();
        names(Path::new("/nowhere"), &paths)
    }

    #[test]
    fn names_keep_dots_and_lose_folders_and_extensions() {
        for (path, name) in [
            ("./train/r_0", "r_0"),
            ("images/a.JPG", "a"),
            ("scan.0001", "scan.0001"),
            ("scan.0001.png", "scan.0001"),
            ("test/r_0.5", "r_0.5"),
            (".\\images\\0001.jpg", "0001"),
            ("./..\\a\\rgb/13.png", "13"),
            ("C:\\data\\1.jpg", "1"),
            ("\\\\host\\share\\2.tif", "2"),
            ("images/", "images"),
            ("a b/\u{e9}.png", "\u{e9}"),
            ("", "frame_0"),
            ("..", "frame_0"),
            ("a/..", "frame_0"),
            (".png", ".png"),
        ] {
            assert_eq!(named(&[path]), [name], "{path}");
        }
    }

    #[test]
    fn frames_of_one_name_are_told_apart_by_their_folders() {
        assert_eq!(named(&["cam0/0001", "cam1/0001", "0002"]), ["cam0_0001", "cam1_0001", "0002"]);
        let deep = ["a/x/1.png", "b/x/1.png", "b/y/1.png", "1.jpg"];
        assert_eq!(named(&deep), ["a_x_1", "b_x_1", "y_1", "1"]);
        assert_eq!(named(&["r/1.png", "r/1.jpg"]), ["r_1.png", "r_1.jpg"]);
        // Duplicates stay duplicates, and the loop ends.
        assert_eq!(named(&["r/1.png", "r/1.png"]), ["1", "1"]);
        assert_eq!(named(&["r/1", "r/1", "r_1"]), ["1", "1", "r_1"]);
        assert_eq!(named(&["r/1", "r_1", "s/1"]), ["r_1", "r_1", "s_1"]);
    }

    #[test]
    fn pictures_are_found_by_path_before_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let here = folder.path();
        for file in ["test/r_0.png", "test/r_0.5.png", "images/1.jpg", "images/2.JPG", "a/1.png"] {
            let path = here.join(file);
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("writable");
            std::fs::write(path, b"").expect("writable");
        }
        let found = |within: &str, path: &str| {
            let folder = here.join(within);
            let name = bare_name(&folder, path).expect("a name");
            let found = photograph_path(&folder, Some(path), &name)?;
            Some(
                found
                    .canonicalize()
                    .expect("there")
                    .strip_prefix(here.canonicalize().expect("there"))
                    .expect("below")
                    .display()
                    .to_string(),
            )
        };
        for (within, path, file) in [
            ("", "./test/r_0.5", Some("test/r_0.5.png")),
            ("test", "./test/r_0.5", Some("test/r_0.5.png")),
            ("test", "./test/r_0", Some("test/r_0.png")),
            ("images", "images/2", Some("images/2.JPG")),
            ("", ".\\images\\1.jpg", Some("images/1.jpg")),
            ("images", "C:\\data\\1.png", Some("images/1.jpg")),
            ("", "elsewhere/images/2.png", None),
            ("", "elsewhere/images/2.JPG", Some("images/2.JPG")),
            ("test", "r_0.7", None),
            ("", "images/1.png", Some("images/1.jpg")),
            ("", "./test/r_0.5.jpg", Some("test/r_0.5.png")),
        ] {
            assert_eq!(found(within, path).as_deref(), file, "{path} in {within}");
        }
        assert!(picture_path(here, "C:\\x\\images\\1.jpg").is_some());
        assert!(picture_path(here, "x/images/1.jpg").is_none());
    }

    #[test]
    fn frames_are_meant_by_name_path_or_number() {
        let frames = [("a_1", Some("a/1.png")), ("b_1", Some("b/1.png")), ("7", Some("7.png"))];
        assert_eq!(find(&frames, "b_1"), Ok(1));
        assert_eq!(find(&frames, "b/1.png"), Ok(1));
        assert_eq!(find(&frames, "7"), Ok(2));
        assert_eq!(find(&frames, "0"), Ok(0));
        assert_eq!(find(&frames, "1"), Err(vec!["a_1".to_owned(), "b_1".to_owned()]));
        assert_eq!(find(&frames, "9"), Err(Vec::new()));
    }
}
