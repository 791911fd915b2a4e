//! The instructions for uploading a folder.

/// The requirements for a server.
pub(super) fn notes(container: &str) -> String {
    format!(
        "\
Upload all files of this folder, and open index.html through the server.

Ranges. The server should answer range requests (Range: bytes=...) for {container}. Then the first
picture comes after a few percent of the file. Without ranges the file is read from its start, and
shows its coarse levels first as well. A server that compresses files on the fly cannot answer range
requests: turn compression off for .mipvog, which is compressed already.

Content types. index.html is text/html, viewer.js and worker.js are text/javascript, style.css is
text/css, {container} is model/vnd.mipvog. A server that does not know the last one may send
application/octet-stream.

Content security policy. This one is enough:
default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; style-src 'self';
img-src 'self' data: blob:; connect-src 'self' data: blob:

Another host. If {container} is on another host than the page, open index.html?file=ADDRESS, and add
that host to connect-src. It must send Access-Control-Allow-Origin, Access-Control-Allow-Headers: Range, and
Access-Control-Expose-Headers: Content-Range, Content-Length.

Links. Programs that show a preview of a link want the address of poster.png in full: put your
site's address before it in index.html (og:image).
"
    )
}
