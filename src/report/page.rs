//! One HTML file with everything in it.

use super::picture::Scale;
use super::{Table, number, write_file};
use base64::{Engine, engine::general_purpose::STANDARD};
use m4gn_base::Result;
use std::path::Path;

/// Charts are drawn on white; in a dark browser they are inverted, with their hues kept.
const STYLE: &str = ":root{color-scheme:light dark}body{font:16px/1.5 system-ui,sans-serif;max-width:64rem;margin:2rem auto;padding:0 1rem}\
h1{font-size:1.6rem}h2{font-size:1.2rem;margin-top:2.2rem}table{border-collapse:collapse;margin:1rem 0;font-variant-numeric:tabular-nums}\
th,td{padding:.25rem .8rem;text-align:right;border-bottom:1px solid #8884}th:first-child,td:first-child{text-align:left}\
thead th{border-bottom:2px solid #888}figure{margin:1.2rem 0}figcaption{opacity:.75;font-size:.9rem}\
.grid{display:grid;gap:.6rem;font-size:.8rem}.grid figure{margin:0}.ticks{display:flex;justify-content:space-between}\
img,svg{max-width:100%;height:auto}p.verdict{font-size:1.1rem}pre{background:#8881;padding:.8rem;overflow-x:auto;font-size:.85rem}\
@media(prefers-color-scheme:dark){svg{filter:invert(.92) hue-rotate(180deg)}}";

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

    /// Pictures (PNG) with their captions, embedded, in a column for each scale, whose colours stand below.
    pub(super) fn pictures(&mut self, pictures: &[(String, Vec<u8>)], scales: &[&Scale]) {
        self.body +=
            &format!("<div class=\"grid\" style=\"grid-template-columns:repeat({},1fr)\">\n", scales.len());
        for (caption, png) in pictures {
            self.body += &format!(
                "<figure><figcaption>{0}</figcaption><img alt=\"{0}\" src=\"data:image/png;base64,{1}\"></figure>\n",
                escape(caption),
                STANDARD.encode(png)
            );
        }
        for scale in scales {
            let colours: Vec<String> =
                scale.colours.iter().map(|[r, g, b]| format!("rgb({r},{g},{b})")).collect();
            let ticks = [0.0, 0.5, 1.0].map(|x| format!("<span>{}</span>", number(x * scale.high, 3)));
            self.body += &format!(
                "<div>{}<div style=\"height:14px;background:linear-gradient(90deg,{})\"></div><div class=\"ticks\">{}</div></div>\n",
                escape(&scale.label),
                colours.join(","),
                ticks.concat()
            );
        }
        self.body += "</div>\n";
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
        let scale = Scale { label: "|U| [m/s]".into(), high: 2.0, colours: &[[0; 3], [1, 2, 3]] };
        page.pictures(&[("picture".into(), vec![1, 2, 3])], &[&scale]);
        let html = page.html();
        assert!(
            html.contains("<title>A &amp; B</title>")
                && html.contains("x &lt; y")
                && html.contains("<figure><svg>")
        );
        assert!(html.contains("base64,AQID") && !html.contains("http"));
    }
}
