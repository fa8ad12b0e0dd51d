//! Header checks before any call. A refusal names the daemon's value, the plugin's value and what to do.

use component_sdk::abi::ABI_VERSION;
use component_sdk::abi::class::ComponentClass;
use component_sdk::abi::header::{CHECKER, MAGIC, PANIC_ABORT, PluginHeader};
use component_sdk::abi::host::HostApi;
use component_sdk::object::TypeDescriptor;

/// A header as plain values, copied out of the plugin.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HeaderView {
    /// First bytes.
    pub magic: [u8; 8],
    /// ABI version.
    pub abi_version: u32,
    /// Size of the header.
    pub header_size: u32,
    /// Panic strategy.
    pub panic_strategy: u32,
    /// Size of the host's table.
    pub host_size: u32,
    /// Size of a class.
    pub class_size: u32,
    /// Size of a descriptor.
    pub descriptor_size: u32,
    /// Layout checker; read only once all before it agree.
    pub checker: String,
    /// Version of the SDK.
    pub sdk_version: String,
    /// Package and version.
    pub build: String,
}

/// First half: what may be compared in a header of any version.
///
/// # Errors
/// In words.
pub fn check_fixed(view: &HeaderView) -> Result<(), String> {
    if view.magic != MAGIC {
        return Err("its entry symbol is no plugin header: use `export_components!` of component-sdk".into());
    }
    same("ABI version", &ABI_VERSION, &view.abi_version)?;
    same("size of the header", &(size_of::<PluginHeader>() as u32), &view.header_size)
}

/// Second half.
///
/// # Errors
/// In words.
pub fn check_rest(view: &HeaderView) -> Result<(), String> {
    if view.panic_strategy == PANIC_ABORT {
        return Err(
            "it is built with panic = \"abort\", so that a panic would end the daemon; the daemon needs panic = \
                    \"unwind\": remove `panic = \"abort\"` from the plugin's Cargo profile and build again"
                .into(),
        );
    }
    same("size of the host table", &(size_of::<HostApi>() as u32), &view.host_size)?;
    same("size of a class", &(size_of::<ComponentClass>() as u32), &view.class_size)?;
    same("size of a type descriptor", &(size_of::<TypeDescriptor>() as u32), &view.descriptor_size)?;
    same("layout checker", CHECKER, view.checker.as_str())
}

fn same<T: PartialEq + std::fmt::Display + ?Sized>(what: &str, daemon: &T, plugin: &T) -> Result<(), String> {
    if daemon == plugin {
        return Ok(());
    }
    let version = env!("CARGO_PKG_VERSION");
    Err(format!(
        "{what}: the daemon has {daemon}, the plugin {plugin}: build the plugin against component-sdk {version}"
    ))
}

/// Where two layouts differ, in a line, of a report that shows every type on the way there: the first error of the innermost
/// type that has one.
#[must_use]
pub fn difference(report: &str) -> String {
    let Some((before, after)) = report.split_once("\nError:") else { return "nobody says where".to_owned() };
    let innermost = before.rsplit_once("Layout of expected type:").map_or(before, |(_, innermost)| innermost);
    let name = innermost.lines().find_map(|line| line.trim().strip_prefix("type:")).unwrap_or("a type").trim();
    let words = after.split("\nError:").next().unwrap_or(after).lines().take_while(|line| !line.contains("error(s)"));
    let words: Vec<&str> = words.flat_map(str::split_whitespace).collect();
    format!("{name}: {}", words.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn good() -> HeaderView {
        HeaderView {
            magic: MAGIC,
            abi_version: ABI_VERSION,
            header_size: size_of::<PluginHeader>() as u32,
            panic_strategy: component_sdk::abi::header::PANIC_UNWIND,
            host_size: size_of::<HostApi>() as u32,
            class_size: size_of::<ComponentClass>() as u32,
            descriptor_size: size_of::<TypeDescriptor>() as u32,
            checker: CHECKER.into(),
            sdk_version: "0.1.0".into(),
            build: "x 1.0".into(),
        }
    }

    #[test]
    fn an_equal_header_is_accepted() {
        assert_eq!(check_fixed(&good()).and_then(|()| check_rest(&good())), Ok(()));
    }

    #[test]
    fn a_refusal_names_both_values_and_the_way_out() {
        let refusal = check_fixed(&HeaderView { abi_version: 99, ..good() }).unwrap_err();
        assert!(refusal.contains(&format!("the daemon has {ABI_VERSION}, the plugin 99")), "{refusal}");
        assert!(refusal.contains("build the plugin against"), "{refusal}");
    }

    #[test]
    fn every_field_counts() {
        let broken = [
            HeaderView { magic: [0; 8], ..good() },
            HeaderView { header_size: 8, ..good() },
            HeaderView { panic_strategy: PANIC_ABORT, ..good() },
            HeaderView { host_size: 8, ..good() },
            HeaderView { class_size: 8, ..good() },
            HeaderView { descriptor_size: 8, ..good() },
            HeaderView { checker: "abi_stable 0.9".into(), ..good() },
        ];
        for view in broken {
            assert!(check_fixed(&view).and_then(|()| check_rest(&view)).is_err(), "{view:?}");
        }
    }

    #[test]
    fn a_report_of_many_pages_comes_down_to_a_line() {
        let report = "Compared <this>:\n --- Type Layout ---\n type:PluginModule\n0 error(s).\n\nLayout of expected type:\n  type:CallArgs<'a>\n\
            0 error(s)inside:\nLayout of expected type:\n    --- Type Layout ---\n    type:Hook\n    size:1\n\n\nError:too many variants\n\
            Expected:\n    13\nFound:\n    12\n";
        assert_eq!(difference(report), "Hook: too many variants Expected: 13 Found: 12");
        assert_eq!(difference("who knows"), "nobody says where");
    }
}
