//! A look at a model's text before MuJoCo sees it: sizes and numbers with which its compiler crashes, hangs or takes all
//! memory are refused with a message. Where the text is no XML, MuJoCo says so.

use super::error::Error;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// Files that a model is made of, at most.
const MOST_FILES: usize = 1000;
/// Numbers of a height field and pixels of a texture, at most: their bytes are counted with 31 bits.
const MOST_SAMPLES: f64 = (1_u64 << 28) as f64;
/// Elements that a composite makes, at most.
const MOST_COMPOSED: f64 = 100_000.0;

/// An attribute whose one number must be in a range: element, attribute, least, most, what is right.
type Range = (&'static str, &'static str, f64, f64, &'static str);

const RANGES: &[Range] = &[
    ("size", "nuser_body", -1.0, 1e5, "from -1 to 100000"),
    ("size", "nuser_jnt", -1.0, 1e5, "from -1 to 100000"),
    ("size", "nuser_geom", -1.0, 1e5, "from -1 to 100000"),
    ("size", "nuser_site", -1.0, 1e5, "from -1 to 100000"),
    ("size", "nuser_cam", -1.0, 1e5, "from -1 to 100000"),
    ("size", "nuser_tendon", -1.0, 1e5, "from -1 to 100000"),
    ("size", "nuser_actuator", -1.0, 1e5, "from -1 to 100000"),
    ("size", "nuser_sensor", -1.0, 1e5, "from -1 to 100000"),
    ("size", "nkey", f64::MIN, 1e5, "at most 100000"),
    ("option", "timestep", f64::MIN_POSITIVE, f64::MAX, "finite and more than zero"),
    ("option", "iterations", f64::MIN, 1e5, "at most 100000"),
    ("option", "ls_iterations", f64::MIN, 1e5, "at most 100000"),
    ("option", "noslip_iterations", f64::MIN, 1e5, "at most 100000"),
    ("option", "sdf_iterations", f64::MIN, 1e5, "at most 100000"),
    ("option", "sdf_initpoints", f64::MIN, 1e5, "at most 100000"),
    ("option", "mpr_iterations", 1.0, 1e5, "from 1 to 100000"),
    ("option", "ccd_iterations", 1.0, 1e5, "from 1 to 100000"),
    ("option", "mpr_tolerance", f64::MIN_POSITIVE, f64::MAX, "finite and more than zero"),
    ("option", "ccd_tolerance", f64::MIN_POSITIVE, f64::MAX, "finite and more than zero"),
    ("lengthrange", "inttotal", 0.0, 1e4, "from 0 to 10000 s"),
    ("lengthrange", "timestep", 0.0, f64::MAX, "finite and zero or more"),
];

/// What MuJoCo's compiler is to be told.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub(super) struct Findings {
    /// It will look for the length ranges of actuators, in threads that hand no fault to the guard.
    pub length_ranges: bool,
}

/// Where the texts of a model come from.
pub(super) struct Sources<'a> {
    /// The folder that relative names are relative to.
    pub folder: &'a Path,
    /// Files in memory, by name.
    pub memory: &'a [(&'a str, &'a [u8])],
}

impl Sources<'_> {
    /// A file that is included from one in `folder`: 2.2.2 looks beside the first file, later versions also beside the
    /// including one.
    fn read(&self, name: &str, folder: &Path) -> Option<(PathBuf, Vec<u8>)> {
        let bare = |name: &str| name.rsplit('/').next().unwrap_or_default().to_lowercase();
        let held = self.memory.iter().find(|(known, _)| bare(known) == bare(name));
        if let Some((name, text)) = held {
            return Some((PathBuf::from(name), text.to_vec()));
        }
        let paths = [self.folder.join(name), folder.join(name)];
        // Only a plain file ends.
        paths.into_iter().filter(|path| path.is_file()).find_map(|path| Some((path.clone(), std::fs::read(path).ok()?)))
    }
}

/// Looks at a text and at all that it includes.
pub(super) fn scan(what: &str, text: &[u8], sources: &Sources<'_>) -> Result<Findings, Error> {
    let mut findings = Findings::default();
    let mut seen = HashSet::new();
    let mut waiting = vec![(PathBuf::from(what), text.to_vec())];
    while let Some((path, text)) = waiting.pop() {
        let refuse = |message| Error::Load { what: path.display().to_string(), message };
        let mut reader = Reader::from_reader(text.as_slice());
        let config = reader.config_mut();
        (config.check_end_names, config.allow_unmatched_ends) = (false, true);
        loop {
            let start = reader.buffer_position();
            match reader.read_event() {
                Ok(Event::Start(tag) | Event::Empty(tag)) => {
                    let element = Element::new(&tag);
                    element.check().map_err(|wrong| {
                        let before = &text[..usize::try_from(start).unwrap_or(0).min(text.len())];
                        let line = 1 + before.iter().filter(|byte| **byte == b'\n').count();
                        refuse(format!("{wrong} (element {:?}, line {line})", element.name))
                    })?;
                    findings.length_ranges |= element.needs_length_ranges();
                    if element.name == "include"
                        && let Some(file) = element.get("file")
                        && seen.len() < MOST_FILES
                        && let Some(included) = sources.read(file, path.parent().unwrap_or(Path::new("")))
                        && seen.insert(included.0.clone())
                    {
                        waiting.push(included);
                    }
                }
                Ok(Event::Eof) | Err(_) => break,
                Ok(_) => {}
            }
        }
    }
    Ok(findings)
}

/// An element and its attributes.
struct Element {
    name: String,
    attributes: Vec<(String, String)>,
}

impl Element {
    fn new(tag: &BytesStart<'_>) -> Self {
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let mut attributes = tag.attributes();
        let attributes = attributes.with_checks(false).flatten().map(|attribute| {
            let value = text(&attribute.value);
            let value = quick_xml::escape::unescape(&value).map_or_else(|_| value.clone(), |value| value.into_owned());
            (text(attribute.key.as_ref()), value)
        });
        Self { attributes: attributes.collect(), name: text(tag.name().as_ref()) }
    }

    fn get(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    /// The numbers of an attribute, as far as they are some.
    fn numbers(&self, name: &str) -> Vec<f64> {
        self.get(name).unwrap_or_default().split_ascii_whitespace().map_while(|word| word.parse().ok()).collect()
    }

    fn needs_length_ranges(&self) -> bool {
        let is_muscle = |name| matches!(self.get(name), Some("muscle" | "user"));
        matches!(self.name.as_str(), "muscle" | "lengthrange") || is_muscle("gaintype") || is_muscle("biastype")
    }

    fn check(&self) -> Result<(), String> {
        for (_, attribute, least, most, right) in RANGES.iter().filter(|range| range.0 == self.name) {
            if let [value] = self.numbers(attribute)[..]
                && !(*least..=*most).contains(&value)
            {
                let written = self.get(attribute).unwrap_or_default();
                return Err(format!("{attribute}=\"{written}\" must be {right}"));
            }
        }
        match self.name.as_str() {
            "hfield" => self.check_product("numbers", MOST_SAMPLES, &[("nrow", 1.0), ("ncol", 1.0)]),
            "texture" if self.get("type") == Some("2d") => {
                self.check_product("pixels", MOST_SAMPLES, &[("width", 1.0), ("height", 1.0)])
            }
            // A cube's six sides are square; its height is not read.
            "texture" => self.check_product("pixels", MOST_SAMPLES, &[("width", 6.0), ("width", 1.0)]),
            "composite" => {
                let made: f64 = self.numbers("count").iter().map(|count| count.max(1.0)).product();
                self.at_most("count", made, "elements", MOST_COMPOSED)
            }
            "mesh" | "skin" => self.check_faces(),
            _ => Ok(()),
        }
    }

    /// The product of sizes, each with a factor; the first is named.
    fn check_product(&self, of: &str, most: f64, sizes: &[(&str, f64)]) -> Result<(), String> {
        let sizes: Vec<_> = sizes.iter().map(|(name, factor)| (*name, factor, self.numbers(name))).collect();
        if let Some((name, ..)) = sizes.iter().find(|(.., numbers)| numbers.first().is_some_and(|size| *size < 0.0)) {
            return Err(format!("{name}=\"{}\" must not be negative", self.get(name).unwrap_or_default()));
        }
        let product = sizes.iter().map(|(_, factor, numbers)| *factor * numbers.first().unwrap_or(&0.0)).product();
        let names: Vec<_> = sizes.iter().map(|(name, ..)| *name).collect();
        let named = if names[0] == names[1] { names[0].into() } else { names.join(" and ") };
        self.at_most(&named, product, of, most)
    }

    fn at_most(&self, attribute: &str, made: f64, of: &str, most: f64) -> Result<(), String> {
        if made <= most || made.is_nan() {
            return Ok(());
        }
        Err(format!("{attribute}: {made} {of} are asked for; at most {most} can be compiled"))
    }

    /// The corners of faces must be among the vertices that stand beside them.
    fn check_faces(&self) -> Result<(), String> {
        let count = self.get("vertex").map(|_| self.numbers("vertex").len() / 3);
        let most = count.map_or(f64::MAX, |count| count as f64 - 1.0);
        match self.numbers("face").into_iter().find(|corner| !(0.0..=most).contains(corner)) {
            Some(corner) => {
                let there_are = count.map_or(String::new(), |count| format!("; there are {count} of them"));
                Err(format!("face has the corner {corner}, which is no vertex (they count from 0){there_are}"))
            }
            None => Ok(()),
        }
    }
}
