//! A table of figures, for the terminal and for HTML.

use std::fmt;

/// Rows under headers; the first column is left-aligned text, the others are right-aligned figures.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// Column headers.
    pub headers: Vec<String>,
    /// Cells, row by row.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// An empty table with these headers.
    pub fn new<S: Into<String>>(headers: impl IntoIterator<Item = S>) -> Self {
        Table { headers: headers.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// Appends a row.
    pub fn row<S: Into<String>>(&mut self, cells: impl IntoIterator<Item = S>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }

    /// The table in Markdown.
    pub fn markdown(&self) -> String {
        let cell = |text: &String| text.replace('\n', " ").replace('|', "\\|");
        let line =
            |cells: &[String]| format!("| {} |\n", cells.iter().map(cell).collect::<Vec<_>>().join(" | "));
        let rule: Vec<String> = self.headers.iter().map(|_| "---".into()).collect();
        std::iter::once(&self.headers).chain([&rule]).chain(&self.rows).map(|l| line(l)).collect()
    }

    /// The table in HTML.
    pub fn html(&self) -> String {
        let line = |tag: &str, cells: &[String]| {
            let cells: String =
                cells.iter().map(|c| format!("<{tag}>{}</{tag}>", super::page::escape(c))).collect();
            format!("<tr>{cells}</tr>\n")
        };
        let body: String = self.rows.iter().map(|r| line("td", r)).collect();
        format!("<table>\n<thead>{}</thead>\n<tbody>\n{body}</tbody>\n</table>\n", line("th", &self.headers))
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines = || std::iter::once(&self.headers).chain(&self.rows);
        let columns = lines().map(Vec::len).max().unwrap_or(0);
        let widths: Vec<usize> = (0..columns)
            .map(|c| lines().filter_map(|l| l.get(c)).map(|s| s.chars().count()).max().unwrap_or(0))
            .collect();
        for (i, cells) in lines().enumerate() {
            let text: Vec<String> = cells
                .iter()
                .zip(&widths)
                .enumerate()
                .map(|(c, (s, &w))| if c == 0 { format!("{s:<w$}") } else { format!("{s:>w$}") })
                .collect();
            writeln!(f, "  {}", text.join("  ").trim_end())?;
            if i == 0 {
                writeln!(f, "  {}", widths.iter().map(|&w| "-".repeat(w)).collect::<Vec<_>>().join("  "))?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up_and_html_is_escaped() {
        let mut table = Table::new(["", "RMSE-1"]);
        table.row(["a < b", "0.5"]);
        table.row(["model", "0.25"]);
        assert_eq!(table.to_string(), "         RMSE-1\n  -----  ------\n  a < b     0.5\n  model    0.25\n");
        assert!(table.html().contains("<td>a &lt; b</td><td>0.5</td>"));
        assert!(table.markdown().starts_with("|  | RMSE-1 |\n| --- | --- |\n| a < b | 0.5 |\n"));
        table.row(["|U|", "1"]);
        assert!(table.markdown().ends_with("| \\|U\\| | 1 |\n"));
    }
}
