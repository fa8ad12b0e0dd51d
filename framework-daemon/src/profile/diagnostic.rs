//! What is wrong, where, and the way out: `file:line:column: error: ...` with the source line, a caret and a hint.
//!
//! The shape is that of compilers, so that editors jump to it. Own code, about a screen of it: the report crates drag in
//! colours and boxes that make golden files and log lines unreadable.

use std::fmt::{self, Display, Formatter};
use std::path::Path;
use std::sync::Arc;

use serde::{Serialize, Serializer};
use serde_json::json;

use super::plan::Location;
use super::source::{Excerpt, Source, Span, Spot, Word};
use super::xml::Element;
use crate::model::limits;

/// How much a diagnostic matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// The profile is refused.
    Error,
    /// Accepted, but probably not what was meant.
    Warning,
    /// Worth knowing.
    Note,
}

impl Level {
    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Error => "error",
            Self::Warning => "warning",
            Self::Note => "note",
        }
    }
}

/// One finding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// How much it matters.
    pub level: Level,
    /// What is wrong.
    pub message: String,
    /// The way out.
    pub hint: Option<String>,
    /// Where; line 0 where the whole file is meant.
    pub location: Location,
    /// The source line and the caret; empty where the whole file is meant.
    pub excerpt: Excerpt,
    /// How many findings it stands for that are not shown.
    hidden: usize,
}

impl Diagnostic {
    /// A finding at a span.
    #[must_use]
    pub fn at(level: Level, source: &Source, span: Span, message: impl Into<String>) -> Self {
        let (excerpt, location) = (source.excerpt(span), source.location(span));
        Self { level, message: message.into(), hint: None, location, excerpt, hidden: 0 }
    }

    /// A finding about a file as a whole.
    #[must_use]
    pub fn of_file(level: Level, path: &Path, message: impl Into<String>) -> Self {
        let location = Location { file: Arc::new(path.to_path_buf()), line: 0, column: 0 };
        Self { level, message: message.into(), hint: None, location, excerpt: Excerpt::default(), hidden: 0 }
    }

    /// The same with a way out; an empty one is none.
    #[must_use]
    pub fn with_hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into()).filter(|hint| !hint.is_empty());
        self
    }

    /// The same with a way out, if there is one.
    #[must_use]
    pub fn with_hint_if(mut self, hint: Option<String>) -> Self {
        self.hint = hint.or(self.hint);
        self
    }

    /// True where the profile is refused.
    #[must_use]
    pub fn is_error(&self) -> bool {
        self.level == Level::Error
    }

    /// What stands below the source line.
    fn caret(&self) -> String {
        let Excerpt { text, indent, width } = &self.excerpt;
        let pad: String = text.chars().take(*indent).map(blank_of).collect();
        format!("{pad}{}", "^".repeat(*width))
    }
}

/// A blank as wide as `c` on a terminal: tabs stay tabs, Korean and Chinese letters are two columns wide.
const fn blank_of(c: char) -> char {
    match c {
        '\t' => '\t',
        '\u{1100}'..='\u{115f}' | '\u{2e80}'..='\u{a4cf}' | '\u{ac00}'..='\u{d7a3}' | '\u{ff00}'..='\u{ff60}' => {
            '\u{3000}'
        }
        _ => ' ',
    }
}

impl Display for Diagnostic {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        let Location { file, line, column } = &self.location;
        write!(out, "{}:", file.display())?;
        if *line > 0 {
            write!(out, "{line}:{column}:")?;
        }
        write!(out, " {}: {}", self.level.name(), self.message)?;
        if *line > 0 {
            write!(out, "\n{line:>6} | {}\n       | {}", self.excerpt.text.trim_end(), self.caret())?;
        }
        if let Some(hint) = &self.hint {
            write!(out, "\n       = {hint}")?;
        }
        Ok(())
    }
}

impl Serialize for Diagnostic {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        json!({
            "level": self.level,
            "file": self.location.file.to_string_lossy(),
            "line": self.location.line,
            "column": self.location.column,
            "width": self.excerpt.width,
            "message": self.message,
            "hint": self.hint,
            "source": self.excerpt.text,
        })
        .serialize(serializer)
    }
}

/// Collects the findings of one file.
#[derive(Debug)]
pub struct Reporter {
    source: Arc<Source>,
    findings: Vec<Diagnostic>,
    /// Takes the hint of a finding beyond the limit.
    beyond: Diagnostic,
    /// How many findings there were beyond the limit.
    hidden: usize,
}

impl Reporter {
    /// A reporter for `source`.
    #[must_use]
    pub fn new(source: Arc<Source>) -> Self {
        let beyond = Diagnostic::of_file(Level::Note, source.path(), "");
        Self { source, findings: Vec::new(), beyond, hidden: 0 }
    }

    /// An error at `span`; the result takes a hint.
    pub fn error(&mut self, span: Span, message: impl Into<String>) -> &mut Diagnostic {
        self.report(Level::Error, span, message)
    }

    /// A warning at `span`; the result takes a hint.
    pub fn warning(&mut self, span: Span, message: impl Into<String>) -> &mut Diagnostic {
        self.report(Level::Warning, span, message)
    }

    /// A note at `span`; the result takes a hint.
    pub fn note(&mut self, span: Span, message: impl Into<String>) -> &mut Diagnostic {
        self.report(Level::Note, span, message)
    }

    /// The note for what is read and validated, but does nothing yet.
    pub fn not_active(&mut self, span: Span, what: &str) {
        self.note(span, format!("{what}: not active yet")).hint =
            Some("it is read and checked, and has no effect in this version".to_owned());
    }

    /// A place to come back to.
    #[must_use]
    pub fn spot(&self, span: Span) -> Spot {
        Spot { source: Arc::clone(&self.source), span }
    }

    /// The text of an element as a word.
    #[must_use]
    pub fn text_word(&self, element: &Element) -> Word {
        Word { text: element.text.clone(), spot: self.spot(element.text_span) }
    }

    /// The value of an attribute as a word; empty, at the element's name, without one.
    #[must_use]
    pub fn value_word(&self, element: &Element, name: &str) -> Word {
        match element.attribute(name) {
            Some(found) => Word { text: found.value.clone(), spot: self.spot(found.value_span) },
            None => Word { text: String::new(), spot: self.spot(element.name_span) },
        }
    }

    /// The words of a list in an attribute, each with its own place.
    #[must_use]
    pub fn value_words(&self, element: &Element, name: &str) -> Vec<Word> {
        let Some(found) = element.attribute(name) else { return Vec::new() };
        let word = |(text, span): (&str, Span)| Word { text: text.to_owned(), spot: self.spot(span) };
        words_of(&found.value, found.value_span).map(word).collect()
    }

    /// File, line and column of `span`.
    #[must_use]
    pub fn location(&self, span: Span) -> Location {
        self.source.location(span)
    }

    /// True where a further finding is only counted: nobody will read its hint.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.findings.len() >= limits::DIAGNOSTICS
    }

    /// All findings.
    #[must_use]
    pub fn into_findings(mut self) -> Vec<Diagnostic> {
        if self.hidden > 0 {
            let message = format!("{} more findings in this file are not shown", self.hidden);
            let hint = "correct some of them and check again";
            let told = Diagnostic::of_file(self.beyond.level, self.source.path(), message).with_hint(hint);
            self.findings.push(Diagnostic { hidden: self.hidden, ..told });
        }
        self.findings
    }

    fn report(&mut self, level: Level, span: Span, message: impl Into<String>) -> &mut Diagnostic {
        // Warnings and notes leave room: an error must not go unseen behind them.
        let limit = if level == Level::Error { limits::DIAGNOSTICS } else { limits::DIAGNOSTICS / 2 };
        if self.findings.len() >= limit {
            self.hidden += 1;
            self.beyond.level = self.beyond.level.min(level);
            return &mut self.beyond;
        }
        self.findings.push(Diagnostic::at(level, &self.source, span, message));
        self.findings.last_mut().unwrap_or(&mut self.beyond)
    }
}

/// The words of a list, each with its own place.
pub fn words_of(list: &str, span: Span) -> impl Iterator<Item = (&str, Span)> {
    let mut offset = 0;
    list.split_whitespace().map(move |text| {
        let at = list.get(offset..).and_then(|rest| rest.find(text)).map_or(offset, |at| offset + at);
        offset = at + text.len();
        (text, Span::new(span.start as usize + at, text.len()))
    })
}

/// Sorts by file (in the order given by `rank`), line and column, removes repetitions, and cuts what is beyond the limit.
pub fn tidy(diagnostics: &mut Vec<Diagnostic>, rank: impl Fn(&Path) -> usize) {
    diagnostics.sort_by_key(|found| {
        let Location { file, line, column } = &found.location;
        (rank(file), *line, *column, found.level)
    });
    diagnostics.dedup();
    for found in diagnostics.iter_mut() {
        clip(&mut found.message);
        found.hint.iter_mut().for_each(clip);
    }
    let shown = diagnostics.iter().filter(|found| found.hidden == 0).count();
    if shown <= limits::DIAGNOSTICS {
        return;
    }
    let hidden: usize = diagnostics.iter().map(|found| found.hidden).sum();
    let beyond = shown - limits::DIAGNOSTICS + hidden;
    diagnostics.retain(|found| found.hidden == 0);
    // Errors must not be cut away behind notes, or a refused profile would look accepted.
    diagnostics.sort_by_key(|found| found.level);
    diagnostics.truncate(limits::DIAGNOSTICS);
    if let Some(last) = diagnostics.last().cloned() {
        let message = format!("{beyond} more findings are not shown");
        diagnostics.push(Diagnostic::of_file(Level::Note, &last.location.file, message));
    }
}

/// A name without end must not hide what is said of it.
fn clip(text: &mut String) {
    const MOST: usize = 2_000;
    const SHOWN: usize = 200;
    if text.len() > MOST {
        let ends = |keep: usize| text.char_indices().nth(keep).map_or(text.len(), |(index, _)| index);
        let begin = text.get(..ends(SHOWN)).unwrap_or_default();
        let end: String = text.chars().rev().take(SHOWN / 2).collect();
        *text = format!("{begin} ... {}", end.chars().rev().collect::<String>());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_caret_stands_under_the_span_even_behind_tabs_and_wide_letters() {
        let source = Source::from_text(Path::new("a.xml"), "\t가<nam>\n".to_owned());
        let found = Diagnostic::at(Level::Error, &source, Span::new(5, 3), "unknown").with_hint("did you mean <name>?");
        let expected =
            "a.xml:1:4: error: unknown\n     1 | \t가<nam>\n       | \t\u{3000} ^^^\n       = did you mean <name>?";
        assert_eq!(found.to_string(), expected);
    }

    #[test]
    fn a_line_without_end_is_cut_around_the_caret() {
        let source = Source::from_text(Path::new("a.xml"), format!("{}<x>{}", "a".repeat(5000), "b".repeat(5000)));
        let text = Diagnostic::at(Level::Error, &source, Span::new(5001, 1), "m").to_string();
        assert!(text.lines().all(|line| line.chars().count() < 200), "{text}");
        assert!(text.contains("<x>"));
    }
}
