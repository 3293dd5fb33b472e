//! What `docs/reference.md` names.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value;

/// A page of `docs/`.
pub fn page(name: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs").join(name)).unwrap()
}

/// The part of the reference under a heading, to the next of its kind.
pub fn section(heading: &str) -> String {
    let page = page("reference.md");
    let start = page.find(&format!("\n{heading}\n")).unwrap_or_else(|| panic!("{heading} is missing"));
    let level = heading.split(' ').next().unwrap();
    let rest = &page[start + heading.len() + 2..];
    let end = [format!("\n{level} "), "\n## ".to_owned()]
        .iter()
        .filter_map(|next| rest.find(next))
        .min()
        .unwrap_or(rest.len());
    rest[..end].to_owned()
}

/// Every name stands in the text as code, or as the head of a table.
#[track_caller]
pub fn named(text: &str, names: impl IntoIterator<Item = String>) {
    let forms = |name: &str| [format!("`{name}`"), format!("`[[{name}]]`"), format!("`[{name}]`")];
    let missing: Vec<String> =
        names.into_iter().filter(|name| !forms(name).iter().any(|form| text.contains(form))).collect();
    assert!(missing.is_empty(), "not on the page: {missing:?}");
}

/// All keys, at any depth.
pub fn collect(value: &Value, keys: &mut BTreeSet<String>) {
    match value {
        Value::Object(map) => map.iter().for_each(|(key, value)| {
            keys.insert(key.clone());
            collect(value, keys);
        }),
        Value::Array(values) => values.iter().for_each(|value| collect(value, keys)),
        _ => {}
    }
}
