//! The demo's own copy of the profile: the same files, with the device and the socket of this run.
//!
//! Decision: text replacement within one element, everything else byte for byte. Parsing and writing the XML anew would
//! lose comments and order, and the copy is there to be compared with the original.

use std::path::Path;

use super::DemoError;

/// What is different in the copy.
#[derive(Debug, Clone, Copy)]
pub struct Changes<'a> {
    /// The motion board's device, for every property `device`.
    pub device: &'a Path,
    /// The camera's socket, for every property `socket`.
    pub socket: &'a Path,
    /// How the first secondary's instance is kept, if not as the profile says: `none`, `library`, `instance`.
    pub preload: Option<&'a str>,
}

/// Copies the profile directory `from` to `to`, which is emptied first, with `changes`.
///
/// # Errors
/// Files cannot be read or written, or no file has what is to be changed.
pub fn copy(from: &Path, to: &Path, changes: Changes<'_>) -> Result<(), DemoError> {
    if to.exists() {
        std::fs::remove_dir_all(to).map_err(DemoError::system("empty", to))?;
    }
    let mut found = Found::default();
    copy_directory(from, to, changes, &mut found)?;
    let missing = |wanted: &str| Err(DemoError::Profile { directory: from.to_owned(), wanted: wanted.into() });
    match found {
        Found { device: false, .. } => missing(r#"a <property name="device">"#),
        Found { socket: false, .. } => missing(r#"a <property name="socket">"#),
        Found { preload: false, .. } if changes.preload.is_some() => missing(r#"a <secondary preload="...">"#),
        Found { .. } => Ok(()),
    }
}

#[derive(Default)]
struct Found {
    device: bool,
    socket: bool,
    preload: bool,
}

fn copy_directory(from: &Path, to: &Path, changes: Changes<'_>, found: &mut Found) -> Result<(), DemoError> {
    std::fs::create_dir_all(to).map_err(DemoError::system("make", to))?;
    for entry in std::fs::read_dir(from).map_err(DemoError::system("read", from))? {
        let source = entry.map_err(DemoError::system("read", from))?.path();
        let target = to.join(source.file_name().unwrap_or_default());
        if source.is_dir() {
            copy_directory(&source, &target, changes, found)?;
        } else if source.extension().is_some_and(|extension| extension == "xml") {
            copy_changed(&source, &target, changes, found)?;
        } else {
            std::fs::copy(&source, &target).map_err(DemoError::system("copy", &source))?;
        }
    }
    Ok(())
}

fn copy_changed(from: &Path, to: &Path, changes: Changes<'_>, found: &mut Found) -> Result<(), DemoError> {
    let bytes = std::fs::read(from).map_err(DemoError::system("read", from))?;
    // A file in another encoding is none of ours; it is copied as it is.
    let Ok(mut text) = String::from_utf8(bytes.clone()) else {
        return std::fs::write(to, bytes).map_err(DemoError::system("write", to));
    };
    found.device |= set_property(&mut text, "device", &changes.device.display().to_string());
    found.socket |= set_property(&mut text, "socket", &changes.socket.display().to_string());
    found.preload |= changes.preload.is_some_and(|preload| set_preload(&mut text, preload));
    std::fs::write(to, text).map_err(DemoError::system("write", to))
}

/// Sets the content of every `<property name="NAME" ...>content</property>`; false if there is none.
fn set_property(text: &mut String, name: &str, value: &str) -> bool {
    each_element(text, "<property", |text, tag, end| {
        if attribute(&text[tag..end], "name").is_none_or(|(from, to)| &text[tag + from..tag + to] != name) {
            return false;
        }
        if text[..end].ends_with('/') {
            text.replace_range(end - 1..=end, &format!(">{value}</property>"));
            return true;
        }
        let Some(length) = text[end..].find("</property") else { return false };
        text.replace_range(end + 1..end + length, value);
        true
    })
}

/// Sets the attribute `preload` of every `<secondary ...>`, and gives it one that has none.
fn set_preload(text: &mut String, value: &str) -> bool {
    each_element(text, "<secondary", |text, tag, end| {
        match attribute(&text[tag..end], "preload") {
            Some((from, to)) => text.replace_range(tag + from..tag + to, value),
            None => text.insert_str(tag + "<secondary".len(), &format!(r#" preload="{value}""#)),
        }
        true
    })
}

/// Calls `change` with the place of every start tag that begins with `tag` and of its `>`; whether any was changed.
fn each_element(text: &mut String, tag: &str, mut change: impl FnMut(&mut String, usize, usize) -> bool) -> bool {
    let (mut from, mut changed) = (0, false);
    while let Some(start) = text[from..].find(tag).map(|offset| from + offset) {
        from = start + tag.len();
        // `<properties>` begins with `<propert` but is another element; so is anything in a comment, after `<!--`.
        let is_it = text[from..].starts_with(|next: char| next.is_whitespace() || next == '>' || next == '/');
        if is_it && !in_comment(&text[..start]) {
            let Some(end) = text[start..].find('>').map(|offset| start + offset) else { return changed };
            changed |= change(text, start, end);
        }
    }
    changed
}

fn in_comment(before: &str) -> bool {
    before.rfind("<!--").is_some_and(|opened| !before[opened..].contains("-->"))
}

/// Where in `tag` the value of the attribute `name` stands.
fn attribute(tag: &str, name: &str) -> Option<(usize, usize)> {
    let found = tag.match_indices(name).find(|(at, _)| {
        tag[..*at].ends_with(char::is_whitespace) && tag[at + name.len()..].trim_start().starts_with('=')
    });
    let after_name = found?.0 + name.len();
    let open = after_name + tag[after_name..].find(['"', '\''])?;
    let quote = tag[open..].chars().next()?;
    let close = open + 1 + tag[open + 1..].find(quote)?;
    Some((open + 1, close))
}

#[cfg(test)]
mod tests {
    use super::{set_preload, set_property};

    #[test]
    fn only_the_named_property_changes() {
        let mut text = String::from(
            "<properties>\n<!-- <property name=\"device\">old</property> -->\n\
             <property type=\"string\" name='device'>/dev/x</property>\n<property name=\"device_id\">7</property>\n\
             <property name=\"device\"/></properties>",
        );
        assert!(set_property(&mut text, "device", "/tmp/board"));
        assert_eq!(
            text,
            "<properties>\n<!-- <property name=\"device\">old</property> -->\n\
             <property type=\"string\" name='device'>/tmp/board</property>\n<property name=\"device_id\">7</property>\n\
             <property name=\"device\">/tmp/board</property></properties>"
        );
        assert!(!set_property(&mut text, "socket", "x"));
    }

    #[test]
    fn preload_is_set_or_added() {
        let mut text =
            String::from(r#"<secondary reference="B.xml" preload="instance"/><secondary reference="C.xml"/>"#);
        assert!(set_preload(&mut text, "none"));
        assert_eq!(
            text,
            r#"<secondary reference="B.xml" preload="none"/><secondary preload="none" reference="C.xml"/>"#
        );
    }
}
