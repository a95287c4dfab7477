//! The self-contained page of an evaluation: tables, followed by examples that show the radar points beside the caption
//! and the references.

use crate::{
    markup::escape,
    page::{PLAYER, Page, STYLE, fill, json_in_html},
};

const TEMPLATE: &str = include_str!("page/report.html");

/// Content of the page, from top to bottom. All text is plain; the page escapes it.
pub struct ReportPage<'a> {
    /// Heading.
    pub title: &'a str,
    /// Lines below the heading: model, data, decoder, size, speed.
    pub about: Vec<String>,
    /// Tables.
    pub tables: Vec<Table>,
    /// Groups of examples.
    pub groups: Vec<Group<'a>>,
}

/// A table of text; the first column is left-aligned.
pub struct Table {
    /// Heading, also used in the table of contents.
    pub title: String,
    /// A sentence below the heading.
    pub about: String,
    /// Column headings.
    pub head: Vec<String>,
    /// Rows, each as long as `head`.
    pub rows: Vec<Vec<String>>,
}

/// Examples under one heading.
pub struct Group<'a> {
    /// Heading, also used in the table of contents.
    pub title: String,
    /// A sentence on how the examples were chosen.
    pub about: String,
    /// Examples.
    pub examples: Vec<Example<'a>>,
}

/// One clip with its points, the generated caption and the references.
pub struct Example<'a> {
    /// The clip, its caption and its points; meshes are not shown.
    pub page: Page<'a>,
    /// Heading: id and action.
    pub heading: String,
    /// Reference captions.
    pub references: &'a [String],
    /// Further lines, such as scores and the nearest training caption.
    pub notes: Vec<String>,
}

impl ReportPage<'_> {
    /// The page as HTML text.
    pub fn to_html(&self) -> String {
        let pages: Vec<&Page> = self
            .groups
            .iter()
            .flat_map(|g| g.examples.iter().map(|e| &e.page))
            .collect();
        let data: Vec<_> = pages.iter().map(|page| page.data()).collect();
        fill(
            TEMPLATE,
            &[
                ("/*STYLE*/", STYLE),
                ("<!--BODY-->", &self.body()),
                ("/*DATA*/", &json_in_html(&data)),
                ("/*PLAYER*/", PLAYER),
            ],
        )
    }

    fn body(&self) -> String {
        let mut out = format!("<h1>{}</h1>\n", escape(self.title));
        for line in &self.about {
            out += &format!("<p class=\"dim\">{}</p>\n", escape(line));
        }
        let tables = self.tables.iter().map(|t| &t.title);
        let titles: Vec<&String> = tables.chain(self.groups.iter().map(|g| &g.title)).collect();
        out += "<nav>";
        for (i, title) in titles.iter().enumerate() {
            out += &format!("<a href=\"#part-{i}\">{}</a> ", escape(title));
        }
        out += "</nav>\n";
        for (i, table) in self.tables.iter().enumerate() {
            out += &heading(i, &table.title, &table.about);
            let long = if table.rows.len() > 16 { " long" } else { "" };
            out += &format!("<div class=\"scroll{long}\"><table>\n<tr>");
            for cell in &table.head {
                out += &format!("<th>{}</th>", escape(cell));
            }
            out += "</tr>\n";
            for row in &table.rows {
                out += "<tr>";
                for cell in row {
                    out += &format!("<td>{}</td>", escape(cell));
                }
                out += "</tr>\n";
            }
            out += "</table></div>\n";
        }
        for (i, group) in self.groups.iter().enumerate() {
            out += &heading(self.tables.len() + i, &group.title, &group.about);
            for example in &group.examples {
                out += &card(example);
            }
        }
        out
    }
}

fn heading(number: usize, title: &str, about: &str) -> String {
    format!(
        "<h2 id=\"part-{number}\">{}</h2>\n<p>{}</p>\n",
        escape(title),
        escape(about)
    )
}

fn card(example: &Example) -> String {
    let references: String = example
        .references
        .iter()
        .map(|text| format!("<li>{}</li>", escape(text)))
        .collect();
    let notes: String = example
        .notes
        .iter()
        .map(|note| format!("<p class=\"dim\">{}</p>", escape(note)))
        .collect();
    format!(
        "<div class=\"example\"><div><canvas class=\"points\"></canvas><div class=\"bar\"><button class=\"play\">Pause</button>\
         <input class=\"time\" type=\"range\" min=\"0\" value=\"0\" step=\"1\" aria-label=\"frame\"><span class=\"clock\"></span>\
         </div></div><div><h3>{}</h3><p class=\"said\">{}</p><p class=\"dim\">References:</p><ul>{references}</ul>{notes}\
         <p class=\"dim\">{}</p></div></div>\n",
        escape(&example.heading),
        escape(example.page.caption),
        escape(example.page.provenance)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOSTILE: &str = "</script><script>alert('1')</script>/*DATA*/<!--BODY-->\"&amp;";

    #[test]
    fn no_text_of_the_data_becomes_markup() {
        let references = [HOSTILE.to_string()];
        let html = |hostile: &str| {
            let page = ReportPage {
                title: hostile,
                about: vec![hostile.into()],
                tables: vec![Table {
                    title: hostile.into(),
                    about: hostile.into(),
                    head: vec![hostile.into()],
                    rows: vec![vec![hostile.into()]],
                }],
                groups: vec![Group {
                    title: hostile.into(),
                    about: hostile.into(),
                    examples: vec![Example {
                        page: Page {
                            caption: hostile,
                            segments: Vec::new(),
                            provenance: hostile,
                            frames: &[],
                            frame_rate_hz: 10.0,
                            radar_height_m: 1.0,
                            mesh: None,
                        },
                        heading: hostile.into(),
                        references: if hostile.is_empty() { &[] } else { &references },
                        notes: vec![hostile.into()],
                    }],
                }],
            };
            page.to_html()
        };
        let (plain, hostile) = (html(""), html(HOSTILE));
        // The text must not add tags or markers to those of the page. Only the list item of the one reference is added.
        let n = |text: &str, what: &str| text.matches(what).count();
        for tag in ["<script", "</script", "/*STYLE*/", "/*PLAYER*/"] {
            assert_eq!(n(&hostile, tag), n(&plain, tag), "{tag}");
        }
        assert_eq!(n(&hostile, "<"), n(&plain, "<") + 2);
        assert!(!hostile.contains("<script>alert") && hostile.contains("&lt;script&gt;alert"));
        // Text that looks like a placeholder of the template is left unchanged.
        assert!(
            n(&plain, "/*DATA*/") == 0
                && hostile.contains("/*DATA*/&lt;!--BODY--&gt;&quot;&amp;amp;")
        );
        // The data block is valid JSON and complete.
        let start = hostile.find("application/json\">").unwrap() + "application/json\">".len();
        let end = start + hostile[start..].find("</script>").unwrap();
        let data: serde_json::Value = serde_json::from_str(&hostile[start..end]).unwrap();
        assert_eq!(data[0]["caption"], HOSTILE);
    }

    #[test]
    fn the_page_loads_nothing() {
        let page = ReportPage {
            title: "t",
            about: Vec::new(),
            tables: Vec::new(),
            groups: Vec::new(),
        };
        let html = page.to_html();
        for word in ["http:", "https:", "src=", "@import", "url(", "fetch("] {
            assert!(!html.contains(word), "{word}");
        }
    }
}
