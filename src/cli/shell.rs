//! Suggested commands in reports, which can be pasted unchanged.

use std::ffi::OsString;
use std::path::Path;
use std::sync::OnceLock;

/// The program's name, if installed.
const NAME: &str = "mipvog-bake";

static TYPED: OnceLock<Vec<OsString>> = OnceLock::new();

/// Stores the command line, starting with the program.
pub fn note_typed(words: &[OsString]) {
    TYPED.get_or_init(|| words.to_vec());
}

/// The command line after the program's name; none if the library is embedded in another program.
pub fn typed() -> Option<&'static [OsString]> {
    TYPED.get()?.get(1..)
}

/// A command of the program, each word quoted as a shell needs it.
pub fn command<T: AsRef<std::ffi::OsStr>>(words: impl IntoIterator<Item = T>) -> String {
    let typed = TYPED.get().and_then(|words| words.first()).map(Path::new);
    let own = match typed.filter(|path| path.components().count() > 1 && !is_found(path)) {
        Some(path) => quoted(&path.to_string_lossy()),
        None => NAME.to_owned(),
    };
    let words = words.into_iter().map(|word| quoted(&word.as_ref().to_string_lossy()));
    std::iter::once(own).chain(words).collect::<Vec<_>>().join(" ")
}

/// True if a shell finds this program by name.
fn is_found(path: &Path) -> bool {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let Ok(own) = path.canonicalize() else { return false };
    let first = std::env::split_paths(&folders)
        .map(|folder| folder.join(NAME).with_extension(std::env::consts::EXE_EXTENSION))
        .find(|found| found.is_file());
    first.and_then(|found| found.canonicalize().ok()).is_some_and(|found| found == own)
}

/// A word, quoted for a shell.
pub fn quoted(word: &str) -> String {
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || "_-./:=@%+,".contains(letter);
    match () {
        () if !word.is_empty() && word.chars().all(is_plain) => word.to_owned(),
        () if cfg!(windows) => format!("\"{word}\""),
        () => format!("'{}'", word.replace('\'', r"'\''")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(unix)]
    fn words_that_a_shell_would_split_are_quoted() {
        assert_eq!(quoted("a/b-1.mipvog"), "a/b-1.mipvog");
        assert_eq!(quoted("my folder/scène.mipvog"), "'my folder/scène.mipvog'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(quoted(""), "''");
        assert_eq!(command(["view", "a b"]), "mipvog-bake view 'a b'");
    }
}
