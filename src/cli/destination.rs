//! The place and kind of the output of `render`, by its name.

use std::path::{Path, PathBuf};

use super::animation::FilmFormat;
use crate::base::error::{Error, Result};

/// Extensions of files that `render` does not write. Names of folders may have any other extension.
const OTHER_FILES: [&str; 16] = [
    "apng", "avi", "bmp", "glb", "gltf", "html", "jpeg", "jpg", "json", "mipvog", "mkv", "npz",
    "ply", "tif", "tiff", "txt",
];

/// The output of `render`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Destination {
    /// A file for each frame and scale.
    Folder(PathBuf),
    /// One picture: an 8-bit PNG.
    Png(PathBuf),
    /// One picture: a float32 EXR.
    Exr(PathBuf),
    /// All frames in one file.
    Film(PathBuf, FilmFormat),
}

impl Destination {
    /// By the extension. Names without one, names with a trailing slash and names of existing
    /// folders are folders.
    ///
    /// # Errors
    /// `Usage` for other extensions.
    pub fn of(path: &Path) -> Result<Self> {
        if path.as_os_str() == "-" {
            let message =
                "--output: pictures do not go to standard output: name a file or a folder";
            return Err(Error::usage(message));
        }
        let slash = path.as_os_str().to_string_lossy().ends_with(std::path::is_separator);
        let extension =
            path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        let Some(extension) = extension.filter(|_| !slash && !path.is_dir()) else {
            return Ok(Self::Folder(path.to_owned()));
        };
        match (extension.as_str(), FilmFormat::of_extension(&extension)) {
            ("png", _) => Ok(Self::Png(path.to_owned())),
            ("exr", _) => Ok(Self::Exr(path.to_owned())),
            (_, Some(format)) => Ok(Self::Film(path.to_owned(), format)),
            (other, None) if !OTHER_FILES.contains(&other) => Ok(Self::Folder(path.to_owned())),
            (other, None) => Err(Error::usage(format!(
                "--output: .{other} is no output of render: .png and .exr are one picture, .{} are \
                 films, and a name without extension or with a slash at its end is a folder of \
                 pictures",
                FilmFormat::EXTENSIONS.join(", .")
            ))
            .in_file(path)),
        }
    }

    /// The file or folder.
    pub fn path(&self) -> &Path {
        match self {
            Self::Folder(path) | Self::Png(path) | Self::Exr(path) | Self::Film(path, _) => path,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kind_of_an_output_follows_from_its_name() {
        let of = |name: &str| Destination::of(Path::new(name));
        let path = |name: &str| PathBuf::from(name);
        assert_eq!(of("pictures").ok(), Some(Destination::Folder(path("pictures"))));
        assert_eq!(of("a.png/").ok(), Some(Destination::Folder(path("a.png/"))));
        assert_eq!(of(".").ok(), Some(Destination::Folder(path("."))));
        assert_eq!(of("..").ok(), Some(Destination::Folder(path(".."))));
        assert_eq!(of("a/b.PNG").ok(), Some(Destination::Png(path("a/b.PNG"))));
        assert_eq!(of("b.exr").ok(), Some(Destination::Exr(path("b.exr"))));
        assert_eq!(of("b.gif").ok(), Some(Destination::Film(path("b.gif"), FilmFormat::Gif)));
        let video = FilmFormat::Video("mp4");
        assert_eq!(of("b.Mp4").ok(), Some(Destination::Film(path("b.Mp4"), video)));
        assert!(of("-").is_err());
        for bad in ["a.avi", "a.jpg", "a.txt", "a.mipvog"] {
            let message = of(bad).expect_err(bad).to_string();
            assert!(message.contains(".gif, .webp, .mp4, .webm, .mov"), "{message}");
        }
    }
}
