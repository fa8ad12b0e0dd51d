//! Whose machine code an address belongs to: the daemon's, a system library's, a plugin's.
//!
//! A table that only grows, because a plugin is never closed. The trap handler reads it: no lock, no allocation.
#![allow(unsafe_code, reason = "address of unsafe: the loader's list of objects")]

use std::ffi::CStr;
use std::ops::Range;
use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::model::limits::TEXTS;

/// Whose code it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Owner {
    /// The daemon's own executable.
    Daemon,
    /// A library that was there before the first plugin: the C library, the loader, the kernel's page.
    System,
    /// A plugin, or a library that came with one.
    Plugin,
}

/// An executable range of addresses.
#[derive(Clone, Debug)]
pub struct Text {
    /// Its addresses.
    pub range: Range<usize>,
    /// What to take from an address to get the one that the file's symbols name.
    pub bias: usize,
    /// File name of what was loaded.
    pub name: &'static str,
    /// Where its file can still be read; empty: nowhere.
    pub path: &'static str,
    /// Whose it is.
    pub owner: Owner,
}

/// What is looked through, apart from what is found: after a while without faults, each line of memory is a wait.
struct Span {
    start: AtomicUsize,
    end: AtomicUsize,
}

static SPANS: [Span; TEXTS] = [const { Span { start: AtomicUsize::new(0), end: AtomicUsize::new(0) } }; TEXTS];
static TABLE: [OnceLock<Text>; TEXTS] = [const { OnceLock::new() }; TEXTS];
static USED: AtomicUsize = AtomicUsize::new(0);

/// Enters what is loaded now, once in a process: the daemon, and what it was linked with.
pub fn install() {
    static ONCE: OnceLock<()> = OnceLock::new();
    ONCE.get_or_init(|| {
        for object in objects() {
            // The loader gives the program itself no name.
            let (name, owner) = match object.path.as_str() {
                "" => ("framework-daemon".to_owned(), Owner::Daemon),
                path => (file_name(path), Owner::System),
            };
            object.enter(&name, owner);
        }
    });
}

/// Enters the plugin that was loaded from `path` under the name of its file, and the libraries that came with it.
/// Returns the new ranges.
pub fn learn(path: &str, file: &Path) -> Vec<Range<usize>> {
    let file = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let mut ranges = Vec::new();
    for object in objects() {
        let is_copy = object.path.starts_with(COPIES);
        // Another thread's copy is entered by that thread, which knows its name.
        if (is_copy && object.path != path) || object.ranges.iter().any(|range| find(range.start).is_some()) {
            continue;
        }
        let name = if is_copy { file.clone() } else { file_name(&object.path) };
        object.enter(&name, Owner::Plugin);
        ranges.extend(object.ranges);
    }
    ranges
}

/// Where private copies of plugins are loaded from.
pub const COPIES: &str = "/proc/self/fd/";

/// Enters a range; false: the table is full, and faults there count as happened elsewhere.
fn add(text: Text) -> bool {
    let index = USED.fetch_add(1, Ordering::AcqRel);
    let (Some(span), Some(place)) = (SPANS.get(index), TABLE.get(index)) else { return false };
    let Range { start, end } = text.range;
    let is_set = place.set(text).is_ok();
    span.start.store(start, Ordering::Relaxed);
    // Last: until then the span holds nothing.
    span.end.store(end, Ordering::Release);
    is_set
}

/// What holds that address.
#[must_use]
pub fn find(pc: usize) -> Option<&'static Text> {
    let used = USED.load(Ordering::Acquire).min(TEXTS);
    let holds = |span: &Span| pc < span.end.load(Ordering::Acquire) && pc >= span.start.load(Ordering::Relaxed);
    // From the end: plugins come last, and it is they that trap.
    SPANS[..used].iter().rposition(holds).and_then(|index| TABLE[index].get())
}

/// Whose code that address is in; `None`: nobody's that is known.
#[must_use]
pub fn owner(pc: usize) -> Option<Owner> {
    find(pc).map(|text| text.owner)
}

/// True in the text of a plugin.
#[must_use]
pub fn is_plugin(pc: usize) -> bool {
    owner(pc) == Some(Owner::Plugin)
}

/// True in the daemon's own text.
#[must_use]
pub fn is_daemon(pc: usize) -> bool {
    owner(pc) == Some(Owner::Daemon)
}

/// File name of the plugin that holds that address.
#[must_use]
pub fn plugin_of(pc: usize) -> Option<&'static str> {
    find(pc).filter(|text| text.owner == Owner::Plugin).map(|text| text.name)
}

/// Something that the loader loaded.
struct Object {
    path: String,
    bias: usize,
    ranges: Vec<Range<usize>>,
}

impl Object {
    fn enter(&self, name: &str, owner: Owner) {
        // Once for each library that is ever loaded; none is ever closed.
        let name: &'static str = String::leak(name.to_owned());
        let path: &'static str = match owner {
            Owner::Daemon => "/proc/self/exe",
            Owner::System | Owner::Plugin => String::leak(self.path.clone()),
        };
        for range in &self.ranges {
            if !add(Text { range: range.clone(), bias: self.bias, name, path, owner }) {
                tracing::warn!("{name}: no room in the table of loaded code: its faults cost their thread");
            }
        }
    }
}

fn file_name(path: &str) -> String {
    path.rsplit('/').next().unwrap_or(path).to_owned()
}

/// All that is loaded, in the loader's order.
fn objects() -> Vec<Object> {
    let mut objects: Vec<Object> = Vec::new();
    // SAFETY: the callback has the signature that is asked for, and its argument outlives the call.
    unsafe { libc::dl_iterate_phdr(Some(note), (&raw mut objects).cast()) };
    objects
}

/// SAFETY: called by `dl_iterate_phdr` only, with a live entry and the list that `objects` passed.
unsafe extern "C" fn note(info: *mut libc::dl_phdr_info, _: usize, list: *mut libc::c_void) -> i32 {
    // SAFETY: both pointers are valid for the time of the call, and nobody else uses the list.
    let (info, list) = unsafe { (&*info, &mut *list.cast::<Vec<Object>>()) };
    let bias = info.dlpi_addr as usize;
    // SAFETY: the loader's name is null or a C string.
    let path = unsafe { info.dlpi_name.as_ref().map(|name| CStr::from_ptr(name)) };
    // SAFETY: the loader's table of that many headers.
    let headers = unsafe { std::slice::from_raw_parts(info.dlpi_phdr, usize::from(info.dlpi_phnum)) };
    let text = headers.iter().filter(|header| header.p_type == libc::PT_LOAD && header.p_flags & libc::PF_X != 0);
    let range = |header: &libc::Elf64_Phdr| {
        let start = bias.wrapping_add(header.p_vaddr as usize);
        start..start.wrapping_add(header.p_memsz as usize)
    };
    let path = path.map(|path| path.to_string_lossy().into_owned()).unwrap_or_default();
    list.push(Object { path, bias, ranges: text.map(range).collect() });
    0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_program_and_the_c_library_are_told_apart() {
        install();
        let libc_function = libc::getppid as *const () as usize;
        let own = the_program_and_the_c_library_are_told_apart as *const () as usize;
        assert!(is_daemon(own) && !is_plugin(own));
        // A function's address in the program may be its entry in the table of jumps.
        let found = find(libc_function).map(|text| text.owner);
        assert!(matches!(found, Some(Owner::System | Owner::Daemon)), "{found:?}");
        assert!(find(0).is_none() && find(usize::MAX).is_none());
    }

    #[test]
    fn a_range_is_found_by_every_address_in_it() {
        let base = 0x6000_0000_0000;
        assert!(add(Text { range: base..base + 100, bias: 0, name: "some.so", path: "", owner: Owner::Plugin }));
        assert_eq!((plugin_of(base), plugin_of(base + 99)), (Some("some.so"), Some("some.so")));
        assert!(plugin_of(base + 100).is_none() && plugin_of(base - 1).is_none());
    }
}
