//! quick-xml events to a small tree of elements, each part with its span.
//!
//! A tree and not serde: serde stops at the first error and forgets where it was, and a loader that reports every error
//! with line and column needs both. quick-xml leaves parts of well-formedness to its user (one root, legal names, `<` in
//! attribute values, text outside the root); they are checked here. A document type is refused as a whole, so that no
//! entity can be declared and none can expand; what remains are the five of XML and character references.

use quick_xml::errors::{Error as XmlError, IllFormedError};
use quick_xml::escape::{EscapeError, resolve_predefined_entity, unescape};
use quick_xml::events::attributes::AttrError;
use quick_xml::events::{BytesRef, BytesStart, Event};
use quick_xml::reader::Reader;

use super::diagnostic::{Diagnostic, Level};
use super::source::{Source, Span};
use crate::model::limits;

/// An element with everything in it.
#[derive(Clone, Debug, Default)]
pub struct Element {
    /// Its name; `conform` puts a name in the wrong case right.
    pub name: String,
    /// Where the name of its start tag stands.
    pub name_span: Span,
    /// Its attributes, in order.
    pub attributes: Vec<Attribute>,
    /// Its child elements, in order.
    pub children: Vec<Element>,
    /// All its own text, references resolved, white space trimmed and condensed as OPRoS's parser does.
    pub text: String,
    /// Where its first text that is not blank stands; the name's span without one.
    pub text_span: Span,
    /// True where `conform` found an attribute or a child that says nothing to it: what is missing here may be meant by that, which
    /// is reported.
    pub misread: bool,
}

/// An attribute.
#[derive(Clone, Debug, Default)]
pub struct Attribute {
    /// Its name.
    pub name: String,
    /// Where the name stands.
    pub name_span: Span,
    /// Its value, references resolved.
    pub value: String,
    /// Where the value stands, without quotes.
    pub value_span: Span,
}

impl Element {
    /// The first child of that name.
    #[must_use]
    pub fn child(&self, name: &str) -> Option<&Self> {
        self.children.iter().find(|child| child.name == name)
    }

    /// Every child of that name.
    pub fn children_of<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Self> {
        self.children.iter().filter(move |child| child.name == name)
    }

    /// Every element `inner` in every child `outer`: `<ports><data_port/>...`.
    pub fn grandchildren<'a>(&'a self, outer: &'a str, inner: &'a str) -> impl Iterator<Item = &'a Self> {
        self.children_of(outer).flat_map(move |child| child.children_of(inner))
    }

    /// The attribute of that name.
    #[must_use]
    pub fn attribute(&self, name: &str) -> Option<&Attribute> {
        self.attributes.iter().find(|attribute| attribute.name == name)
    }

    /// The text of the first child of that name; empty without one.
    #[must_use]
    pub fn text_of(&self, name: &str) -> &str {
        self.child(name).map_or("", |child| child.text.as_str())
    }

    /// The value of the attribute of that name; empty without one.
    #[must_use]
    pub fn value_of(&self, name: &str) -> &str {
        self.attribute(name).map_or("", |attribute| attribute.value.as_str())
    }
}

/// Reads a source into its root element.
///
/// # Errors
/// Everything that is not well-formed, refused or beyond a limit. A reader that lost its way stops at that place; what
/// it can step over (attributes, names) is reported together.
pub fn parse(source: &Source) -> Result<Element, Vec<Diagnostic>> {
    let mut builder = Builder::new(source);
    builder.run();
    builder.finish()
}

struct Builder<'a> {
    source: &'a Source,
    open: Vec<Element>,
    root: Option<Element>,
    elements: usize,
    /// True where a document type is refused: it may declare whatever is referred to.
    has_type: bool,
    findings: Vec<Diagnostic>,
}

impl<'a> Builder<'a> {
    const fn new(source: &'a Source) -> Self {
        Self { source, open: Vec::new(), root: None, elements: 0, has_type: false, findings: Vec::new() }
    }

    fn run(&mut self) {
        let mut reader = Reader::from_str(self.source.text());
        let config = reader.config_mut();
        config.expand_empty_elements = true;
        config.trim_markup_names_in_closing_tags = true;
        config.check_comments = true;
        loop {
            let at = usize::try_from(reader.buffer_position()).unwrap_or(usize::MAX);
            match reader.read_event() {
                Ok(Event::Eof) => return,
                Ok(event) => {
                    if !self.take(event, at) {
                        return;
                    }
                }
                Err(XmlError::IllFormed(IllFormedError::DoubleHyphenInComment)) => return self.dashes_in_comment(at),
                Err(error) => {
                    let at = usize::try_from(reader.error_position()).unwrap_or(usize::MAX);
                    return self.reader_error(&error, at);
                }
            }
        }
    }

    /// False where reading on makes no sense.
    fn take(&mut self, event: Event<'a>, at: usize) -> bool {
        match event {
            Event::Start(start) => return self.start(&start),
            Event::End(_) => self.end(),
            Event::Text(text) => self.text(&text.into_inner(), at),
            Event::CData(data) => self.text(&data.into_inner(), at),
            Event::GeneralRef(reference) => self.reference(&reference, at),
            Event::DocType(_) => {
                self.has_type = true;
                self.error(Span::new(at, "<!DOCTYPE".len()), "a document type (DTD) is not allowed in a profile")
                    .hint = Some("remove the <!DOCTYPE ...>: profiles declare no entities".to_owned());
            }
            Event::Decl(_) if at != 0 => {
                self.error(
                    Span::new(at, "<?xml".len()),
                    "the XML declaration must be the very first thing in the file",
                );
            }
            Event::Decl(_) | Event::PI(_) | Event::Comment(_) | Event::Empty(_) | Event::Eof => {}
        }
        true
    }

    fn start(&mut self, start: &BytesStart<'a>) -> bool {
        let name = start.name().0;
        let name_span = self.span_of(name);
        if self.root.is_some() {
            self.error(name_span, format!("<{name}> stands behind the end of the root element")).hint =
                Some("a profile has one root element: put a second one into a file of its own".to_owned());
            return false;
        }
        if name.is_empty() {
            self.error(name_span, "< begins an element without a name").hint =
                Some("where the character is meant, write it as &lt;".to_owned());
            return false;
        }
        self.elements += 1;
        if self.open.len() >= limits::PROFILE_DEPTH || self.elements > limits::PROFILE_ELEMENTS {
            let limit = if self.open.len() >= limits::PROFILE_DEPTH {
                format!("elements nest deeper than {}", limits::PROFILE_DEPTH)
            } else {
                format!("more than {} elements in one file", limits::PROFILE_ELEMENTS)
            };
            self.error(name_span, limit);
            return false;
        }
        self.check_name(name, name_span, "element");
        let attributes = self.attributes(start);
        self.open.push(Element {
            name: name.to_owned(),
            name_span,
            attributes,
            text_span: name_span,
            ..Element::default()
        });
        true
    }

    fn end(&mut self) {
        let Some(mut element) = self.open.pop() else { return };
        element.text = condense(&element.text);
        match self.open.last_mut() {
            Some(parent) => parent.children.push(element),
            None => self.root = Some(element),
        }
    }

    fn text(&mut self, text: &str, at: usize) {
        let blank_before = text.len() - text.trim_start().len();
        let span = Span::new(at + blank_before, text.trim().len());
        let Some(element) = self.open.last_mut() else {
            if !text.trim().is_empty() {
                self.error(span, "text outside of the root element").hint = Some(
                    "a profile is XML, one element with all in it: remove the text, or make it a comment".to_owned(),
                );
            }
            return;
        };
        // Blanks before the first text are left out, so that an empty text says at once that there was none.
        if element.text.is_empty() {
            if text.trim().is_empty() {
                return;
            }
            element.text_span = span;
        }
        if element.text.len() + text.len() <= limits::PROFILE_TEXT_BYTES {
            element.text.push_str(text);
        } else {
            self.error(span, format!("more than {} bytes of text in one element", limits::PROFILE_TEXT_BYTES));
        }
    }

    fn reference(&mut self, reference: &BytesRef<'a>, at: usize) {
        let character = match reference.resolve_char_ref() {
            Ok(Some(c)) if is_allowed(c) => Some(c.to_string()),
            Ok(None) => resolve_predefined_entity(reference).map(str::to_owned),
            Ok(Some(_)) | Err(_) => None,
        };
        let span = Span::new(at, reference.len() + 2);
        match character {
            Some(text) => self.text(&text, at),
            None => self.bad_reference(span),
        }
    }

    fn bad_reference(&mut self, span: Span) {
        if self.has_type {
            return;
        }
        let text = self.source.text().get(span.start as usize..span.end as usize).unwrap_or("&").to_owned();
        self.error(span, format!("unknown reference {text}")).hint = Some(
            "only &lt; &gt; &amp; &quot; &apos; and character references like &#176; exist; write & as &amp;"
                .to_owned(),
        );
    }

    fn attributes(&mut self, start: &BytesStart<'a>) -> Vec<Attribute> {
        let mut attributes = Vec::new();
        let tag = self.span_of(start.name().0).start as usize;
        for found in start.attributes() {
            if attributes.len() >= limits::PROFILE_ATTRIBUTES_PER_ELEMENT {
                self.error(Span::new(tag, 1), "too many attributes in one element");
                break;
            }
            match found {
                Ok(found) => {
                    let attribute = self.attribute(found.key.0, &found.value);
                    self.check_blank_before(&attribute);
                    attributes.push(attribute);
                }
                Err(error) => self.attribute_error(&error, tag),
            }
        }
        attributes
    }

    /// The reader takes `a="1"b="2"`, which XML does not.
    fn check_blank_before(&mut self, attribute: &Attribute) {
        let before = self.source.text().get(..attribute.name_span.start as usize).unwrap_or_default();
        if before.ends_with(['"', '\'']) {
            self.error(attribute.name_span, format!("a blank is missing before {}", attribute.name)).hint =
                Some("attributes are separated by blanks".to_owned());
        }
    }

    fn attribute(&mut self, name: &str, raw: &str) -> Attribute {
        let (name_span, value_span) = (self.span_of(name), self.span_of(raw));
        self.check_name(name, name_span, "attribute");
        if let Some(at) = raw.find('<') {
            self.error(Span::new(value_span.start as usize + at, 1), "raw < in an attribute value").hint =
                Some("write it as &lt;".to_owned());
        }
        let value = match unescape(raw) {
            Ok(value) => value.replace(['\t', '\n', '\r'], " "),
            Err(error) => {
                self.bad_reference(reference_span(&error, raw, value_span));
                String::new()
            }
        };
        if let Some(c) = value.chars().find(|c| !is_allowed(*c)) {
            self.error(value_span, format!("character U+{:04X} is not allowed in XML", u32::from(c)));
        }
        Attribute { name: name.to_owned(), name_span, value, value_span }
    }

    fn attribute_error(&mut self, error: &AttrError, tag: usize) {
        let (at, message) = match error {
            AttrError::ExpectedEq(at) => (*at, "an attribute needs a value: name=\"value\""),
            AttrError::ExpectedValue(at) => (*at, "a value in quotes is missing behind ="),
            AttrError::UnquotedValue(at) => (*at, "an attribute's value must stand in quotes"),
            AttrError::ExpectedQuote(at, _) => (*at, "the closing quote is missing"),
            AttrError::Duplicated(at, _) => (*at, "this attribute stands here twice"),
        };
        let typographic = |c: char| matches!(c, '\u{201c}' | '\u{201d}' | '\u{201e}' | '\u{2018}' | '\u{2019}');
        let is_typographic = self.source.text().get(tag + at..).is_some_and(|rest| rest.starts_with(typographic));
        let hint = is_typographic.then(|| "these are typographic quotes: write straight ones, \" or '".to_owned());
        self.error(Span::new(tag + at, 1), message).hint = hint;
    }

    fn check_name(&mut self, name: &str, span: Span, what: &str) {
        let first = |c: char| c.is_alphabetic() || matches!(c, '_' | ':');
        let later = |c: char| c.is_alphanumeric() || matches!(c, '_' | ':' | '-' | '.');
        if !name.starts_with(first) || !name.chars().all(later) {
            self.error(span, format!("\"{}\" is not a legal {what} name", name.escape_debug()));
        }
    }

    fn reader_error(&mut self, error: &XmlError, at: usize) {
        let (width, message, hint) = match error {
            XmlError::IllFormed(IllFormedError::MismatchedEndTag { expected, found }) => {
                let opened = self.open.last().map_or(0, |open| self.source.location(open.name_span).line);
                let message = format!("</{found}> closes nothing: <{expected}> of line {opened} is still open");
                (found.len() + 3, message, Some(format!("write </{expected}> here, or close it earlier")))
            }
            XmlError::IllFormed(IllFormedError::UnmatchedEndTag(found)) => {
                (found.len() + 3, format!("</{found}> closes nothing: no element is open"), None)
            }
            XmlError::IllFormed(IllFormedError::UnclosedReference) => {
                (1, "& begins a reference that does not end".to_owned(), Some("write & as &amp;".to_owned()))
            }
            other if plain(other).starts_with("attribute value not closed") => (
                1,
                "an attribute of this element has no closing quote".to_owned(),
                Some("write name=\"value\"".to_owned()),
            ),
            other => (1, format!("not well-formed: {}", plain(other)), None),
        };
        self.error(Span::new(at.min(self.source.text().len()), width), message).hint = hint;
    }

    /// In the comment at `at`. Where in it the reader does not say right.
    fn dashes_in_comment(&mut self, at: usize) {
        const BEGIN: &str = "<!--";
        let rest = self.source.text().get(at..).unwrap_or_default();
        let begin = rest.find(BEGIN).map_or(at, |found| at + found);
        let inside = self.source.text().get(begin + BEGIN.len()..).unwrap_or_default();
        let dashes = inside.find("--").map_or(begin, |found| begin + BEGIN.len() + found);
        let line = self.source.location(Span::new(begin, BEGIN.len())).line;
        self.error(Span::new(dashes, 2), format!("-- in the comment that begins in line {line}")).hint = Some(
            "only --> may have two dashes: write one, or close the comment before; comments do not nest".to_owned(),
        );
    }

    fn finish(mut self) -> Result<Element, Vec<Diagnostic>> {
        if self.findings.is_empty() {
            if let Some(open) = self.open.last() {
                let (span, message) = (open.name_span, format!("<{}> is never closed", open.name));
                self.error(span, message);
            } else if self.root.is_none() {
                let hint = "write a profile, `framework-daemon schema` tells what it may hold, or remove the file";
                self.error(Span::new(self.source.text().len(), 0), "the file holds no element").hint =
                    Some(hint.to_owned());
            }
        }
        match self.root {
            Some(root) if self.findings.is_empty() => Ok(root),
            _ => Err(self.findings),
        }
    }

    fn error(&mut self, span: Span, message: impl Into<String>) -> &mut Diagnostic {
        self.findings.push(Diagnostic::at(Level::Error, self.source, span, message));
        let last = self.findings.len() - 1;
        &mut self.findings[last]
    }

    /// quick-xml hands out slices of the text it was given, so their addresses tell where they stand.
    fn span_of(&self, part: &str) -> Span {
        let text = self.source.text();
        let offset = (part.as_ptr() as usize).wrapping_sub(text.as_ptr() as usize);
        if offset <= text.len() { Span::new(offset, part.len()) } else { Span::default() }
    }
}

fn reference_span(error: &EscapeError, raw: &str, value: Span) -> Span {
    let range = match error {
        EscapeError::UnrecognizedEntity(range, _) | EscapeError::UnterminatedEntity(range) => range.clone(),
        EscapeError::InvalidCharRef(_) | EscapeError::TooManyNestedEntities => 0..raw.len(),
    };
    // quick-xml's range leaves out the & and the ; around an unknown entity's name.
    let start = raw.get(..range.start).and_then(|before| before.rfind('&')).unwrap_or(0);
    let length = raw.get(start..).and_then(|rest| rest.find(';')).map_or(1, |end| end + 1);
    Span::new(value.start as usize + start, length)
}

/// True for the characters that XML 1.0 knows.
pub(super) const fn is_allowed(c: char) -> bool {
    matches!(c, '\t' | '\n' | '\r') || (c >= ' ' && !matches!(c, '\u{fffe}' | '\u{ffff}'))
}

fn plain(error: &XmlError) -> String {
    let text = error.to_string();
    text.strip_prefix("syntax error: ")
        .or_else(|| text.strip_prefix("ill-formed document: "))
        .unwrap_or(&text)
        .to_owned()
}

/// Trims, and makes every run of white space one blank.
fn condense(text: &str) -> String {
    text.split_ascii_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use proptest::prelude::*;

    use super::*;

    fn parse_text(text: &str) -> Result<Element, Vec<Diagnostic>> {
        parse(&Source::from_text(Path::new("a.xml"), text.to_owned()))
    }

    fn first_error(text: &str) -> (u32, u32, String) {
        let errors = parse_text(text).err().unwrap_or_default();
        errors.first().map_or((0, 0, String::new()), |e| (e.location.line, e.location.column, e.message.clone()))
    }

    #[test]
    fn the_tree_has_names_attributes_text_and_their_places() {
        let text = "<?xml version=\"1.0\"?>\n<a>\n  <b c='1 &lt; 2'> x &amp;\n  <![CDATA[<y>]]> </b>\n</a>";
        let root = parse_text(text).unwrap_or_default();
        let b = root.child("b").cloned().unwrap_or_default();
        assert_eq!(b.text, "x & <y>");
        assert_eq!(b.value_of("c"), "1 < 2");
        assert_eq!(&text[b.text_span.start as usize..][..1], "x");
        assert_eq!(&text[b.attributes[0].value_span.start as usize..][..1], "1");
    }

    #[test]
    fn what_is_not_well_formed_is_located() {
        let cases = [
            ("<a>\n <b></a>", (2, 5)),
            ("<a>\n <b>", (2, 3)),
            ("<a/>\n<b/>", (2, 2)),
            ("<a/>x", (1, 5)),
            ("<a b='<'/>", (1, 7)),
            ("<a b='&nope;'/>", (1, 7)),
            ("<a>&nope;</a>", (1, 4)),
            ("<a> & </a>", (1, 5)),
            ("<a b=1/>", (1, 6)),
            ("<a b='1' b='2'/>", (1, 10)),
            ("<1a/>", (1, 2)),
            ("", (1, 1)),
            ("\n<!DOCTYPE a [<!ENTITY x 'y'>]><a/>", (2, 1)),
            (" <?xml version='1.0'?><a/>", (1, 2)),
            ("<a>&#1;</a>", (1, 4)),
        ];
        for (text, at) in cases {
            let (line, column, message) = first_error(text);
            assert_eq!((line, column), at, "{text:?}: {message}");
        }
    }

    #[test]
    fn depth_is_limited() {
        assert!(first_error(&"<a>".repeat(100_000)).2.contains("deeper"));
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in ".{0,200}") {
            let _ = parse_text(&text);
        }

        #[test]
        fn arbitrary_markup_never_panics(parts in proptest::collection::vec(
            proptest::sample::select(vec!["<", ">", "/", "a", "=", "'", "\"", "&", ";", "!", "-", "[", "]", "?", "CDATA", "가", " ", "\r", "#"]), 0..60)) {
            let _ = parse_text(&parts.concat());
        }
    }
}
