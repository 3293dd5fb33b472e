//! One HTML file with everything in it: it opens without a network, on a phone and on paper.

mod text;

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use super::chart::TimeChart;
use super::error::ReportError;
use crate::whole_file::write_whole;
use text::{base64, escaped, in_data_url};

/// A page under construction: sections from top to bottom, each with blocks. What it is given as text is shown as text.
///
/// ```
/// use mujoco_grasp::report::Page;
/// let mut page = Page::new("clutch", "What a grasp did.");
/// page.section("Results");
/// page.table("Outcomes", &[vec!["push".into(), "outcome".into()], vec!["<fp1>".into(), "held".into()]]);
/// page.numbers(&[("full-fp1.csv".into(), "trajectory".into(), "time_s\n0.1\n".into())]);
/// assert!(page.html().contains("&lt;fp1&gt;"));
/// ```
#[derive(Debug, Clone)]
pub struct Page {
    title: String,
    lead: String,
    /// Title of each section.
    sections: Vec<String>,
    /// The sections' HTML.
    body: String,
    /// JPEG pictures that films and stills are made of, as base64.
    frames: Vec<String>,
    charts: usize,
}

/// Frames of both modes over time, with a slider.
#[derive(Debug, Clone, Default)]
pub struct Film {
    /// What it shows, for those who do not see it.
    pub about: String,
    /// Time of each frame \[s\], ascending, finite.
    pub times_s: Vec<f64>,
    /// Said beside the time of each frame: "latched". One for each time.
    pub notes: Vec<&'static str>,
    /// Of each mode its name, and for each time the frame, by its number.
    pub rows: Vec<(String, Vec<usize>)>,
    /// What is shown at first, by its place among the times.
    pub first: usize,
}

/// Both modes at a telling moment.
#[derive(Debug, Clone, Default)]
pub struct Still {
    /// "peak".
    pub label: String,
    /// When \[s\].
    pub time_s: f64,
    /// Of each mode its name and the frame, by its number.
    pub rows: Vec<(String, usize)>,
}

impl Page {
    /// A page with a heading and a line below it.
    pub fn new(title: impl Into<String>, lead: impl Into<String>) -> Self {
        let (title, lead) = (title.into(), lead.into());
        Self { title, lead, sections: Vec::new(), body: String::new(), frames: Vec::new(), charts: 0 }
    }

    /// Adds pictures, as JPEG, for films and stills, which know them by their numbers: from 0 in this order.
    pub fn frames(&mut self, jpegs: &[Vec<u8>]) {
        self.frames.extend(jpegs.iter().map(|jpeg| base64(jpeg)));
    }

    /// Begins a section, which the contents at the top name.
    pub fn section(&mut self, title: &str) {
        if !self.sections.is_empty() {
            self.body.push_str("</section>\n");
        }
        self.sections.push(title.to_owned());
        let _ = writeln!(self.body, "<section id=\"s{}\"><h2>{}</h2>", self.sections.len(), escaped(title));
    }

    /// A heading within a section.
    pub fn heading(&mut self, title: &str) {
        let _ = writeln!(self.body, "<h3>{}</h3>", escaped(title));
    }

    /// A paragraph.
    pub fn text(&mut self, text: &str) {
        let _ = writeln!(self.body, "<p>{}</p>", escaped(text));
    }

    /// Two columns where there is room, the second half as wide as the first; else one below the other.
    pub fn columns<T>(&mut self, first: impl FnOnce(&mut Self), second: impl FnOnce(&mut Self) -> T) -> T {
        self.body.push_str("<div class=\"columns\"><div>\n");
        first(self);
        self.body.push_str("</div><div>\n");
        let made = second(self);
        self.body.push_str("</div></div>\n");
        made
    }

    /// A table; the first row and the first column are headings.
    pub fn table(&mut self, caption: &str, rows: &[Vec<String>]) {
        let caption = escaped(caption);
        // What is too wide for a phone is scrolled, by the keyboard as well.
        let _ = write!(
            self.body,
            "<div class=\"table\" role=\"region\" tabindex=\"0\" aria-label=\"{caption}\">\
             <table><caption>{caption}</caption><thead>"
        );
        for (r, row) in rows.iter().enumerate() {
            self.body.push_str("<tr>");
            for (c, cell) in row.iter().enumerate() {
                let (tag, scope) = match (r, c) {
                    (0, _) => ("th", " scope=\"col\""),
                    (_, 0) => ("th", " scope=\"row\""),
                    _ => ("td", ""),
                };
                let _ = write!(self.body, "<{tag}{scope}>{}</{tag}>", escaped(cell));
            }
            self.body.push_str(if r == 0 { "</tr></thead><tbody>" } else { "</tr>\n" });
        }
        self.body.push_str("</tbody></table></div>\n");
    }

    /// Frames of both modes side by side, with a button, a slider and the times at which charts of the section have a line.
    pub fn film(&mut self, film: &Film) {
        let about = escaped(&film.about);
        let _ = writeln!(self.body, "<div class=\"film\" role=\"group\" aria-label=\"{about}\"><div class=\"modes\">");
        for (mode, frames) in &film.rows {
            let mode = escaped(mode);
            let picture = frames.get(film.first).and_then(|&f| self.frames.get(f)).map_or("", String::as_str);
            let _ = writeln!(
                self.body,
                "<figure><img src=\"data:image/jpeg;base64,{picture}\" alt=\"{about}, {mode}\"><figcaption>{mode}</figcaption>\
                 </figure>"
            );
        }
        let rows: Vec<&Vec<usize>> = film.rows.iter().map(|(_, frames)| frames).collect();
        let _ = writeln!(
            self.body,
            "</div><div class=\"controls\" hidden><button type=\"button\">Play</button>\
             <input type=\"range\" min=\"0\" max=\"{}\" value=\"{}\" aria-label=\"time\">\
             <select aria-label=\"speed\"><option value=\"1\">real time</option><option value=\"0.25\">4 times slower</option>\
             <option value=\"0.1\">10 times slower</option></select><output></output></div>\
             <script type=\"application/json\">{{\"times\":{:?},\"rows\":{rows:?},\"notes\":{:?},\"first\":{}}}</script>\
             <noscript><p>The film needs JavaScript; the stills below do not.</p></noscript></div>",
            film.times_s.len().saturating_sub(1),
            film.first,
            film.times_s,
            film.notes,
            film.first
        );
    }

    /// Telling moments in both modes.
    pub fn stills(&mut self, about: &str, stills: &[Still]) {
        self.body.push_str("<div class=\"stills\">\n");
        for still in stills {
            let when = format!("{}, {:.2} s", still.label, still.time_s);
            self.body.push_str("<figure>");
            for (mode, frame) in &still.rows {
                let picture = self.frames.get(*frame).map_or("", String::as_str);
                let (alt, mode) = (escaped(&format!("{about}, {mode}: {when}")), escaped(mode));
                let _ = write!(
                    self.body,
                    "<div><img src=\"data:image/jpeg;base64,{picture}\" alt=\"{alt}\"><span>{mode}</span></div>"
                );
            }
            let _ = writeln!(self.body, "<figcaption>{}</figcaption></figure>", escaped(&when));
        }
        self.body.push_str("</div>\n");
    }

    /// What the charts' lines and grounds mean.
    pub fn key(&mut self) {
        self.body.push_str(include_str!("page/key.html"));
    }

    /// Charts side by side, as many as there is room for. Their numbers are in the file that `numbers` names, see
    /// [`numbers`](Self::numbers).
    ///
    /// # Errors
    /// As [`TimeChart::svg`].
    pub fn charts(&mut self, about: &str, charts: &[TimeChart], numbers: &str) -> Result<(), ReportError> {
        self.body.push_str("<div class=\"charts\">\n");
        for chart in charts {
            let svg = chart.svg()?;
            let (start, end) = chart.window().unwrap_or_default();
            let [left, right, top, bottom] = TimeChart::AXES;
            let now = format!(
                "<line class=\"now\" visibility=\"hidden\" y1=\"{top}\" y2=\"{bottom}\" data-from=\"{start}\" \
                 data-to=\"{end}\" data-left=\"{left}\" data-right=\"{right}\"/>"
            );
            let title = format!("{about}: {}", chart.name());
            self.drawing(&svg, &title, &chart.in_words(), &now);
            let _ = writeln!(self.body, "<figcaption>{}</figcaption></figure>", escaped(chart.name()));
        }
        let (anchor, file) = (anchor(numbers), escaped(numbers));
        let _ = writeln!(self.body, "</div><p class=\"source\">Numbers: <a href=\"#{anchor}\">{file}</a></p>");
        Ok(())
    }

    /// A plot that has another form than charts over time, as an SVG document, with its text alternative and the file of its
    /// numbers.
    pub fn plot(&mut self, svg: &str, title: &str, in_words: &str, numbers: &str) {
        self.body.push_str("<div class=\"wide\">");
        self.drawing(svg, title, in_words, "");
        let (title, anchor, file) = (escaped(title), anchor(numbers), escaped(numbers));
        let _ = writeln!(
            self.body,
            "<figcaption>{title}; numbers: <a href=\"#{anchor}\">{file}</a></figcaption></figure></div>"
        );
    }

    /// An SVG document as part of the page, in a figure that is left open.
    fn drawing(&mut self, svg: &str, title: &str, in_words: &str, more: &str) {
        self.charts += 1;
        let id = self.charts;
        let (head, content) = svg.split_once('>').unwrap_or_default();
        let view_box = head.split("viewBox=\"").nth(1).and_then(|v| v.split('"').next()).unwrap_or_default();
        let content = content.trim_end().trim_end_matches("</svg>");
        let _ = write!(
            self.body,
            "<figure><svg viewBox=\"{view_box}\" role=\"img\" aria-labelledby=\"t{id} d{id}\"><title id=\"t{id}\">{}</title>\
             <desc id=\"d{id}\">{}</desc>{content}{more}</svg>",
            escaped(title),
            escaped(in_words)
        );
    }

    /// Files that the page holds, to be saved: name, what is in it, CSV.
    pub fn numbers(&mut self, files: &[(String, String, String)]) {
        self.body.push_str("<ul class=\"numbers\">\n");
        for (name, about, csv) in files {
            let (anchor, name, about) = (anchor(name), escaped(name), escaped(about));
            let _ = writeln!(
                self.body,
                "<li id=\"{anchor}\"><a download=\"{name}\" href=\"data:text/csv;charset=utf-8,{}\">{name}</a>: {about}</li>",
                in_data_url(csv)
            );
        }
        self.body.push_str("</ul>\n");
    }

    /// The whole page.
    pub fn html(&self) -> String {
        let (title, lead) = (escaped(&self.title), escaped(&self.lead));
        let entry =
            |(i, section): (usize, &String)| format!("<li><a href=\"#s{}\">{}</a></li>", i + 1, escaped(section));
        let contents: String = self.sections.iter().enumerate().map(entry).collect();
        let end = if self.sections.is_empty() { "" } else { "</section>" };
        let (css, js, body) = (include_str!("page/page.css"), include_str!("page/page.js"), &self.body);
        format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n\
             <link rel=\"icon\" href=\"data:,\">\n<style>\n{css}</style>\n</head>\n<body>\n\
             <header><h1>{title}</h1><p>{lead}</p></header>\n\
             <nav aria-label=\"contents\"><ul>{contents}</ul></nav>\n<main>\n{body}{end}\n</main>\n\
             <script type=\"application/json\" id=\"frames\">{:?}</script>\n<script>\n{js}</script>\n</body>\n</html>\n",
            self.frames
        )
    }

    /// Saves the page, and returns its size in bytes.
    ///
    /// # Errors
    /// [`ReportError::Format`] for a name that does not end in `.html`, [`ReportError::Write`] with the system's reason.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<u64, ReportError> {
        let path = path.as_ref();
        if super::canvas::extension(path) != "html" {
            return Err(ReportError::Format { path: path.to_owned(), wanted: ".html" });
        }
        let html = self.html();
        write_whole(path, |file| file.write_all(html.as_bytes()))
            .map_err(|source| ReportError::Write { path: path.to_owned(), source })?;
        Ok(html.len() as u64)
    }
}

/// The place of a file of numbers in the page.
fn anchor(file: &str) -> String {
    let plain = |c: char| {
        if c.is_ascii_alphanumeric() || "-._".contains(c) { c.to_string() } else { format!("_{:x}", c as u32) }
    };
    format!("numbers-{}", file.chars().map(plain).collect::<String>())
}
