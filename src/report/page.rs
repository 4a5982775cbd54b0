//! One HTML file with everything in it.

use super::{Table, write_file};
use base64::{Engine, engine::general_purpose::STANDARD};
use m4gn_base::Result;
use std::path::Path;

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;color:#222;max-width:64rem;margin:2rem auto;padding:0 1rem}\
h1{font-size:1.6rem}h2{font-size:1.2rem;margin-top:2.2rem}table{border-collapse:collapse;margin:1rem 0;font-variant-numeric:tabular-nums}\
th,td{padding:.25rem .8rem;text-align:right;border-bottom:1px solid #ddd}th:first-child,td:first-child{text-align:left}\
thead th{border-bottom:2px solid #888}figure{margin:1.2rem 0}figcaption{color:#555;font-size:.9rem}\
img,svg{max-width:100%;height:auto}p.verdict{font-size:1.1rem}pre{background:#f6f6f6;padding:.8rem;overflow-x:auto;font-size:.85rem}";

/// Replaces what HTML would read as markup.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A page that is being written.
pub struct Page {
    title: String,
    body: String,
}

impl Page {
    /// A page with a title and nothing else.
    pub fn new(title: &str) -> Self {
        Page { title: title.into(), body: String::new() }
    }

    /// A section's heading.
    pub fn heading(&mut self, text: &str) {
        self.body += &format!("<h2>{}</h2>\n", escape(text));
    }

    /// A paragraph of plain text.
    pub fn paragraph(&mut self, text: &str) {
        self.body += &format!("<p>{}</p>\n", escape(text));
    }

    /// Text as it is, in a fixed-width font.
    pub fn listing(&mut self, text: &str) {
        self.body += &format!("<pre>{}</pre>\n", escape(text));
    }

    /// A table.
    pub fn table(&mut self, table: &Table) {
        self.body += &table.html();
    }

    /// An SVG drawing, inline.
    pub fn svg(&mut self, svg: &str, caption: &str) {
        // An XML declaration has no place inside HTML.
        let start = svg.find("<svg").unwrap_or(0);
        self.body +=
            &format!("<figure>{}<figcaption>{}</figcaption></figure>\n", &svg[start..], escape(caption));
    }

    /// A PNG picture, embedded; `width` is the width on the page in pixels.
    pub fn png(&mut self, png: &[u8], width: usize, caption: &str) {
        self.body += &format!(
            "<figure><img width=\"{width}\" alt=\"{0}\" src=\"data:image/png;base64,{1}\"><figcaption>{0}</figcaption></figure>\n",
            escape(caption),
            STANDARD.encode(png)
        );
    }

    /// The whole page.
    pub fn html(&self) -> String {
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head><meta charset=\"utf-8\"><meta name=\"viewport\" \
             content=\"width=device-width\"><title>{0}</title><style>{STYLE}</style></head>\n<body>\n<h1>{0}</h1>\n{1}\
             <p><small>Written by m4gn {2}.</small></p>\n</body>\n</html>\n",
            escape(&self.title),
            self.body,
            env!("CARGO_PKG_VERSION")
        )
    }

    /// Writes the page.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_file(path, self.html().as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_needs_nothing_from_outside() {
        let mut page = Page::new("A & B");
        page.paragraph("x < y");
        page.svg("<?xml version=\"1.0\"?><svg></svg>", "chart");
        page.png(&[1, 2, 3], 10, "picture");
        let html = page.html();
        assert!(
            html.contains("<title>A &amp; B</title>")
                && html.contains("x &lt; y")
                && html.contains("<figure><svg>")
        );
        assert!(html.contains("base64,AQID") && !html.contains("http"));
    }
}
