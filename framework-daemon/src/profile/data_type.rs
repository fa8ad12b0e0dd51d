//! `data_type`: communication objects as structures of fields.

use std::collections::BTreeSet;

use serde::Serialize;

use super::diagnostic::Reporter;
use super::xml::Element;

/// A structure.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Struct {
    /// Its type name.
    pub name: String,
    /// Its fields, in order.
    pub items: Vec<Item>,
}

/// A field.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Item {
    /// Its name.
    pub name: String,
    /// Its type.
    #[serde(rename = "type")]
    pub type_name: String,
}

/// Reads `<data_type>`.
pub fn read(root: &Element, report: &mut Reporter) -> Vec<Struct> {
    let mut names = BTreeSet::new();
    let mut all = Vec::new();
    for element in root.children_of("struct") {
        let name = report.value_word(element, "name");
        if !names.insert(name.text.clone()) {
            report.error(name.spot.span, format!("struct \"{}\" is already defined in this file", name.text));
        }
        all.push(Struct { name: name.text, items: items(element, report) });
    }
    all
}

fn items(element: &Element, report: &mut Reporter) -> Vec<Item> {
    let mut names = BTreeSet::new();
    let mut all = Vec::new();
    for item in element.children_of("item") {
        if !item.text.is_empty() && !names.insert(&item.text) {
            report.error(item.text_span, format!("field \"{}\" is already defined in this struct", item.text));
        }
        all.push(Item { name: item.text.clone(), type_name: item.value_of("type").to_owned() });
    }
    all
}
