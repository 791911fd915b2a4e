//! Folders in place of files: the file in them that a verb takes, or what to type.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use clap::builder::{PathBufValueParser, TypedValueParser};
use mipvog_inputs::tensor::extensions;

/// The scene in a folder of DirectVoxGO's or Mip-VoG's training.
const CHECKPOINT: &str = "fine_last.tar";
/// Camera files of a scene's folder, the first one first.
const CAMERAS: [&str; 6] = [
    "transforms.json",
    "transforms_test.json",
    "images.bin",
    "images.txt",
    "sparse/0/images.bin",
    "sparse/0/images.txt",
];
/// Extensions of files that verbs read, beside those of trained models.
const OWN_INPUTS: [&str; 2] = ["glb", "mipvog"];
/// Verbs that take no models.
const OF_BAKED: [&str; 5] = ["attach", "detach", "transcode", "unpack", "view"];
/// Extensions of packed files, which are not unpacked here.
const PACKED: [&str; 5] = ["bz2", "gz", "xz", "zip", "zst"];
/// Maximum files of a folder in a message.
const NAMED: usize = 3;

/// The path of an input; for the folder of a training, its checkpoint.
pub fn input_path() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().map(|path| {
        let is_described = mipvog_inputs::file_of(&path) != path;
        inner(path, &[CHECKPOINT], is_described)
    })
}

/// The path of a camera file; for a scene's folder, the file in it.
pub fn camera_path() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().map(|path| inner(path, &CAMERAS, false))
}

/// The first of these files in a folder; else the path itself.
fn inner(path: PathBuf, names: &[&str], is_whole: bool) -> PathBuf {
    if is_whole || !path.is_dir() {
        return path;
    }
    let found = names.iter().map(|name| path.join(name)).find(|file| file.is_file());
    found.unwrap_or(path)
}

/// The remedy for a folder in place of a file: it may hold files that the verb takes.
pub fn of_folder(folder: &Path) -> String {
    let verb = std::env::args().skip(1).find(|word| !word.starts_with('-'));
    of_folder_for(verb.as_deref(), folder)
}

fn of_folder_for(verb: Option<&str>, folder: &Path) -> String {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let (folders, mut files): (Vec<PathBuf>, Vec<PathBuf>) =
        entries.map(|entry| entry.path()).partition(|path| path.is_dir());
    files.sort_unstable();
    let extension = |path: &PathBuf| Some(path.extension()?.to_str()?.to_owned());
    let takes_models = !verb.is_some_and(|verb| OF_BAKED.contains(&verb));
    let is_read = |path: &&PathBuf| {
        let models = extensions().filter(|_| takes_models);
        let mut known = OWN_INPUTS.into_iter().chain(models);
        // Settings and cameras are JSON too.
        extension(path).is_some_and(|own| own != "json" && known.any(|of| of == own))
    };
    if verb == Some("bake") && folders.iter().any(|folder| folder.join(CHECKPOINT).is_file()) {
        let all = folder.join("*").join(CHECKPOINT);
        return format!("pass the scenes in it: {} -o baked/", all.display());
    }
    if verb == Some("compare") && files.iter().any(|path| is_picture(path)) {
        return "pictures are a reference, which comes before the field".to_owned();
    }
    let named = |files: Vec<&PathBuf>| {
        let names = files.into_iter().take(NAMED).map(|path| path.display().to_string());
        names.collect::<Vec<_>>().join(", ")
    };
    let found: Vec<&PathBuf> = files.iter().filter(is_read).collect();
    let packed = |path: &&PathBuf| extension(path).is_some_and(|own| PACKED.contains(&&*own));
    let packed: Vec<&PathBuf> = files.iter().filter(packed).collect();
    match (found.is_empty(), packed.is_empty()) {
        (false, false) => {
            format!("pass a file in it: {}; or unpack {}", named(found), named(packed))
        }
        (false, true) => format!("pass a file in it: {}", named(found)),
        (true, false) => format!("unpack the file in it, and pass it: {}", named(packed)),
        (true, true) => {
            "pass a file instead of a folder: a model, a container, or cameras such as transforms.json".to_owned()
        }
    }
}

fn is_picture(path: &Path) -> bool {
    let extension = path.extension().and_then(OsStr::to_str).unwrap_or_default();
    ["png", "jpg", "jpeg", "exr"].contains(&extension.to_ascii_lowercase().as_str())
}
