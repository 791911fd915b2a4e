//! The viewer's page, changed to open one container.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest as _, Sha256};

use super::site::{PAGE, SCRIPT, STYLE, WORKER};
use crate::report_page::escaped;

/// Elements of the viewer's page that are replaced.
const LINK: &str = "<link rel=\"stylesheet\" href=\"style.css\" />";
const IMPORT: &str = "<script type=\"module\" src=\"viewer.js\"></script>";
const CHARSET: &str = "<meta charset=\"utf-8\" />";
const BODY: &str = "<body>";
const END: &str = "</body>";

/// Elements of data in a page: [`data_of`] finds them again.
const DATA: &str = "<script type=\"text/plain\" id=\"data\">";
const SCRIPT_END: &str = "</script>";

/// A page that holds the container `bytes`, which it shows as `name`.
pub(super) fn whole(name: &str, bytes: &[u8]) -> String {
    let policy = format!(
        "default-src 'none'; script-src {} 'wasm-unsafe-eval'; style-src {}; worker-src blob:; \
         img-src data: blob:; connect-src data: blob:; base-uri 'none'; form-action 'none'",
        digest(SCRIPT),
        digest(STYLE),
    );
    let policy =
        format!("<meta http-equiv=\"Content-Security-Policy\" content=\"{policy}\" />\n    ");
    let data = STANDARD.encode(bytes);
    titled(name)
        .replacen(CHARSET, &format!("{CHARSET}\n    {policy}"), 1)
        .replacen(LINK, &format!("<style>{STYLE}</style>"), 1)
        .replacen(
            END,
            &format!(
                "<script type=\"text/plain\" id=\"worker\">{WORKER}{SCRIPT_END}\n    \
                 {DATA}{data}{SCRIPT_END}\n  {END}"
            ),
            1,
        )
        // Last, so that no text in the script matches one of these elements.
        .replacen(IMPORT, &format!("<script type=\"module\">{SCRIPT}{SCRIPT_END}"), 1)
}

/// A page beside the container `name`, with a picture for link previews.
pub(super) fn linking(name: &str, poster: &str, [width, height]: [usize; 2]) -> String {
    let title = escaped(title(name));
    let tags = format!(
        "<meta property=\"og:type\" content=\"website\" />\n    \
         <meta property=\"og:title\" content=\"{title}\" />\n    \
         <meta property=\"og:image\" content=\"{poster}\" />\n    \
         <meta property=\"og:image:width\" content=\"{width}\" />\n    \
         <meta property=\"og:image:height\" content=\"{height}\" />\n    \
         <meta name=\"twitter:card\" content=\"summary_large_image\" />"
    );
    titled(name).replacen(CHARSET, &format!("{CHARSET}\n    {tags}"), 1)
}

/// The container of a page from [`whole`]; none in other texts.
pub(super) fn data_of(page: &str) -> Option<Vec<u8>> {
    let (_, data) = page.rsplit_once(DATA)?;
    let (data, _) = data.split_once(SCRIPT_END)?;
    STANDARD.decode(data).ok()
}

/// The page with a name and a file of its own.
fn titled(name: &str) -> String {
    let body = format!("<body data-file=\"{}\">", escaped(name));
    let (start, end) = PAGE.split_once("<title>").unwrap_or((PAGE, ""));
    let (_, end) = end.split_once("</title>").unwrap_or(("", end));
    format!("{start}<title>{}</title>{end}", escaped(title(name))).replacen(BODY, &body, 1)
}

/// A file's name without its ending.
fn title(name: &str) -> &str {
    name.strip_suffix(".mipvog").unwrap_or(name)
}

/// The hash of a script or style for a content security policy.
fn digest(text: &str) -> String {
    format!("'sha256-{}'", STANDARD.encode(Sha256::digest(text)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_element_is_there_once() {
        for element in [LINK, IMPORT, CHARSET, BODY, END, "<title>", "</title>"] {
            assert_eq!(PAGE.matches(element).count(), 1, "{element}");
        }
        // No text that ends an element early, and no carriage return, which browsers change.
        for (text, end) in [(SCRIPT, "</script"), (WORKER, "</script"), (STYLE, "</style")] {
            assert!(!text.to_lowercase().contains(end) && !text.contains("<!--"));
            assert!(!text.contains('\r'));
        }
    }

    #[test]
    fn a_page_gives_its_container_back() {
        let page = whole("a \"b\" & <c>.mipvog", b"\x89 bytes");
        assert_eq!(data_of(&page).as_deref(), Some(&b"\x89 bytes"[..]));
        assert!(page.contains("<title>a &quot;b&quot; &amp; &lt;c&gt;</title>"));
        assert!(page.contains("data-file=\"a &quot;b&quot; &amp; &lt;c&gt;.mipvog\""));
        assert_eq!(data_of(PAGE), None);
    }
}
