//! Text inside HTML and SVG, in elements and in attributes.

/// The text with special characters of HTML and XML as entities.
pub fn escaped(text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    text.replace('"', "&quot;").replace('\'', "&#39;")
}
