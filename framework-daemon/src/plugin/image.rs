//! What a plugin file says before it is loaded: loading runs constructors, reading does not.

use object::{Object, ObjectSymbol};

use component_sdk::abi::header::SYMBOL_PREFIX;

/// What was read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Name of the entry symbol.
    pub symbol: String,
    /// The linker's build id in hexadecimal; empty where the linker wrote none.
    pub build_id: String,
}

/// Reads a shared library's symbols.
///
/// # Errors
/// In words, when it is no shared library of this machine, or no plugin.
pub fn read(bytes: &[u8]) -> Result<Image, String> {
    let file = object::File::parse(bytes).map_err(|error| format!("it is no shared library: {error}"))?;
    let wanted = std::env::consts::ARCH;
    let found = match file.architecture() {
        object::Architecture::X86_64 => "x86_64",
        object::Architecture::Aarch64 => "aarch64",
        _ => "another processor",
    };
    if found != wanted {
        return Err(format!("it is built for {found}, this machine is {wanted}: build it for this target"));
    }
    let symbol = file
        .dynamic_symbols()
        .filter(ObjectSymbol::is_definition)
        .filter_map(|symbol| symbol.name().ok())
        .find(|name| name.starts_with(SYMBOL_PREFIX))
        .ok_or_else(|| {
            format!("it exports no symbol `{SYMBOL_PREFIX}...`: add `export_components!(YourComponent);` and crate-type `cdylib`")
        })?;
    let build_id = file.build_id().ok().flatten().map(hexadecimal).unwrap_or_default();
    Ok(Image { symbol: symbol.to_owned(), build_id })
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_library_is_told_from_what_is_no_plugin() {
        assert!(read(b"hello").unwrap_err().contains("no shared library"));
        let own = std::fs::read(std::env::current_exe().unwrap()).unwrap();
        assert!(read(&own).unwrap_err().contains("exports no symbol"));
    }
}
