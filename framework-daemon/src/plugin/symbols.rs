//! Which function an address lies in: our own lookup, by an ordinary thread, long after the fault.
//!
//! The symbol tables are those of the files that were loaded: a plugin's private copy is still open under its number. Each is
//! read when a fault first needs it, and kept. (The symboliser behind `RUST_BACKTRACE=1` takes 50 to 150 ms for its first
//! panic, on the thread that panics.)

use std::collections::HashMap;

use object::{Object, ObjectSymbol, SymbolKind};
use serde::Serialize;

use crate::model::fault::TrapEvidence;
use crate::model::limits::SYMBOL_FILE_BYTES;
use crate::sys::text;

/// A place in what is loaded.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Place {
    /// File name of the plugin or library.
    pub module: &'static str,
    /// Offset in it, as its symbols count.
    pub module_offset: u64,
    /// The function, where its file still has symbols.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub function: Option<Function>,
}

/// A place in a function.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Function {
    /// Its name, demangled.
    pub function: String,
    /// Offset in it.
    pub offset: u64,
}

/// Where a trap struck.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Origin {
    /// The instruction.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub at: Option<Place>,
    /// The plugin's function that called it, where the instruction is not the plugin's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub caller: Option<String>,
}

/// Symbols by file, as far as they were needed.
#[derive(Default)]
pub struct Symbols {
    tables: HashMap<&'static str, Table>,
}

impl Symbols {
    /// Where a trap struck, and from where in a plugin that was called.
    pub fn origin(&mut self, trap: &TrapEvidence) -> Origin {
        let is_plugin = |address: &u64| usize::try_from(*address).is_ok_and(text::is_plugin);
        let caller = if is_plugin(&trap.pc) { None } else { self.caller(trap.stack.into_iter().filter(is_plugin)) };
        Origin { at: self.place(trap.pc), caller: caller.map(|place| place.to_string()) }
    }

    /// The nearest function of the component's own, past those of the standard library that came with it.
    fn caller(&mut self, addresses: impl Iterator<Item = u64>) -> Option<Place> {
        let mut nearest = None;
        for address in addresses {
            // A return address may lie behind the last instruction of its function: the call is before it.
            let place = self.place(address - 1);
            if place.as_ref().is_some_and(|place| !place.is_runtime()) {
                return place;
            }
            nearest = nearest.or(place);
        }
        nearest
    }

    /// What lies at that address.
    pub fn place(&mut self, address: u64) -> Option<Place> {
        let text = text::find(usize::try_from(address).ok()?)?;
        let module_offset = address.wrapping_sub(text.bias as u64);
        let table = self.tables.entry(text.path).or_insert_with(|| Table::of_file(text.path));
        Some(Place { module: text.name, module_offset, function: table.find(module_offset) })
    }
}

/// How functions of the standard library begin.
const RUNTIME: [&str; 4] = ["std::", "core::", "alloc::", "__rust"];

impl Place {
    fn is_runtime(&self) -> bool {
        let name = self.function.as_ref().map(|function| function.function.trim_start_matches(['<', '&']));
        name.is_some_and(|name| RUNTIME.iter().any(|begin| name.starts_with(begin)))
    }
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { module, module_offset, function } = self;
        match function {
            Some(Function { function, offset }) => write!(f, "{function}+{offset:#x} ({module})"),
            None => write!(f, "{module}+{module_offset:#x}"),
        }
    }
}

/// Functions of a file, sorted by address.
#[derive(Default)]
struct Table(Vec<Symbol>);

struct Symbol {
    address: u64,
    size: u64,
    name: Box<str>,
}

impl Table {
    /// Of a file that cannot be read, or that has no symbols, it is empty.
    fn of_file(path: &str) -> Self {
        let small = std::fs::metadata(path).is_ok_and(|metadata| metadata.len() <= SYMBOL_FILE_BYTES);
        let bytes = small.then(|| std::fs::read(path).ok()).flatten().unwrap_or_default();
        object::File::parse(bytes.as_slice()).map_or_else(|_| Self::default(), |file| Self::of(&file))
    }

    fn of(file: &object::File<'_>) -> Self {
        let full = functions(file.symbols());
        // A file that was stripped still exports some.
        let mut symbols = if full.is_empty() { functions(file.dynamic_symbols()) } else { full };
        symbols.sort_by_key(|symbol| symbol.address);
        symbols.dedup_by_key(|symbol| symbol.address);
        Self(symbols)
    }

    fn find(&self, address: u64) -> Option<Function> {
        let behind = self.0.partition_point(|symbol| symbol.address <= address);
        let symbol = self.0.get(behind.checked_sub(1)?)?;
        let offset = address - symbol.address;
        let function = || format!("{:#}", rustc_demangle::demangle(&symbol.name));
        (offset < symbol.size).then(|| Function { function: function(), offset })
    }
}

fn functions<'data>(symbols: impl Iterator<Item = impl ObjectSymbol<'data>>) -> Vec<Symbol> {
    symbols
        .filter(|symbol| symbol.is_definition() && symbol.kind() == SymbolKind::Text)
        .filter_map(|symbol| {
            Some(Symbol { address: symbol.address(), size: symbol.size(), name: symbol.name().ok()?.into() })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[inline(never)]
    extern "C" fn a_function_of_this_test(number: u64) -> u64 {
        std::hint::black_box(number) + 1
    }

    fn address_here() -> u64 {
        a_function_of_this_test as extern "C" fn(u64) -> u64 as usize as u64
    }

    #[test]
    fn an_address_is_found_by_function_and_offset() {
        text::install();
        assert_eq!(a_function_of_this_test(1), 2);
        let place = Symbols::default().place(address_here() + 3).unwrap();
        let function = place.function.unwrap();
        assert!(function.function.ends_with("a_function_of_this_test"), "{}", function.function);
        assert_eq!(function.offset, 3);
    }

    #[test]
    fn the_standard_librarys_functions_are_told_from_the_components() {
        let place = |name: &str| {
            let function = Function { function: name.into(), offset: 1 };
            Place { module: "libx.so", module_offset: 1, function: Some(function) }
        };
        assert!(place("std::thread::functions::sleep").is_runtime());
        assert!(place("<core::ops::Range<T> as Iterator>::next").is_runtime());
        assert!(!place("<avoider::Avoider as component_sdk::component::Callbacks>::on_execute").is_runtime());
    }

    #[test]
    fn what_is_nowhere_has_no_place() {
        text::install();
        let origin = Symbols::default().origin(&TrapEvidence::new(libc::SIGSEGV, 0, 0x10));
        assert_eq!(origin, Origin::default());
        assert_eq!(serde_json::to_string(&origin).unwrap(), "{}");
    }

    #[test]
    fn an_address_behind_a_function_is_not_in_it() {
        let symbol = |address, size, name: &str| Symbol { address, size, name: name.into() };
        let table = Table(vec![symbol(10, 5, "a"), symbol(20, 5, "b")]);
        let found = |address| table.find(address).map(|function| (function.function, function.offset));
        assert_eq!(found(9), None);
        assert_eq!(found(14), Some(("a".into(), 4)));
        assert_eq!(found(15), None);
        assert_eq!(found(20), Some(("b".into(), 0)));
        assert_eq!(found(99), None);
    }
}
