//! Elements of an SVG document as text; everything that comes from outside is escaped here.

use std::fmt::Write;

const STYLE: &str = "text{font-family:'Inter','Segoe UI','DejaVu Sans',sans-serif;font-size:12px;fill:#1f2937}\
.title{font-size:19px;font-weight:600}.quiet{fill:#6b7280}.small{font-size:10.5px;fill:#6b7280}\
.number{font-size:11px;font-weight:700;fill:#fff;text-anchor:middle}.label{font-size:11px;font-weight:600;fill:#991b1b}\
.middle{text-anchor:middle}.end{text-anchor:end}.head{font-size:11px;font-weight:600;fill:#6b7280}";

/// Collects elements in the order in which they are painted.
pub(super) struct Canvas {
    body: String,
}

impl Canvas {
    pub(super) fn new() -> Self {
        Self { body: String::new() }
    }

    /// Text at its baseline; `class` is one or more of the classes in the style.
    pub(super) fn text(&mut self, x: f64, y: f64, class: &str, text: &str) {
        self.put(&format!(r#"<text x="{x:.1}" y="{y:.1}" class="{class}">{}</text>"#, escaped(text)));
    }

    pub(super) fn line(&mut self, from: (f64, f64), to: (f64, f64), style: &str) {
        let ((x1, y1), (x2, y2)) = (from, to);
        self.put(&format!(r#"<line x1="{x1:.1}" y1="{y1:.1}" x2="{x2:.1}" y2="{y2:.1}" style="{style}"/>"#));
    }

    pub(super) fn circle(&mut self, centre: (f64, f64), radius: f64, style: &str) {
        let (x, y) = centre;
        self.put(&format!(r#"<circle cx="{x:.1}" cy="{y:.1}" r="{radius:.1}" style="{style}"/>"#));
    }

    /// A rectangle turned by `degrees` clockwise about its centre.
    pub(super) fn rectangle(&mut self, centre: (f64, f64), size: (f64, f64), degrees: f64, style: &str) {
        let ((x, y), (width, height)) = (centre, size);
        self.put(&format!(
            r#"<rect x="{:.1}" y="{:.1}" width="{width:.1}" height="{height:.1}" rx="3" transform="rotate({degrees:.1} {x:.1} {y:.1})" style="{style}"/>"#,
            x - width / 2.0,
            y - height / 2.0,
        ));
    }

    pub(super) fn polyline(&mut self, points: &[(f64, f64)], style: &str) {
        let points = points.iter().fold(String::new(), |mut list, (x, y)| {
            let _never_fails = write!(list, "{x:.1},{y:.1} ");
            list
        });
        self.put(&format!(r#"<polyline points="{}" style="fill:none;{style}"/>"#, points.trim_end()));
    }

    /// The whole document.
    pub(super) fn document(self, width: f64, height: f64) -> String {
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height:.0}\" viewBox=\"0 0 {width} {height:.0}\">\n\
             <style>{STYLE}</style>\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n{}</svg>\n",
            self.body
        )
    }

    fn put(&mut self, element: &str) {
        self.body.push_str(element);
        self.body.push('\n');
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    #[test]
    fn text_from_outside_cannot_break_out() {
        let mut canvas = super::Canvas::new();
        canvas.text(0.0, 0.0, "quiet", "</text><script>\"&");
        assert!(canvas.document(1.0, 1.0).contains("&lt;/text&gt;&lt;script&gt;&quot;&amp;</text>"));
    }
}
