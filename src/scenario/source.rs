//! Where a scenario comes from: built into the program, or a file.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::builtin::{self, Builtin};
use super::error::Error;
use super::file::ScenarioFile;
use crate::mujoco::Model;

/// The text of a scenario and the place of its model.
#[derive(Clone, Debug)]
pub struct Source {
    /// The file, for messages.
    pub path: PathBuf,
    /// TOML.
    pub text: Cow<'static, str>,
    builtin: Option<&'static Builtin>,
}

/// A built-in scenario, for `mujoco-grasp list`.
#[derive(Clone, Debug, Serialize)]
pub struct Listed {
    /// Its name.
    pub name: String,
    /// What it is about.
    pub about: String,
}

/// All built-in scenarios.
///
/// # Errors
/// None in a program whose own scenarios are sound.
pub fn list() -> Result<Vec<Listed>, Error> {
    builtin::ALL
        .iter()
        .map(|b| {
            let file = ScenarioFile::parse(b.toml, Path::new(b.path))?;
            Ok(Listed { name: b.name.to_owned(), about: file.about.unwrap_or_default() })
        })
        .collect()
}

impl Source {
    /// A built-in scenario by its name, else a file by its path.
    ///
    /// # Errors
    /// [`Error::Unknown`], [`Error::Read`], [`Error::Mjcf`].
    pub fn find(scenario: &str) -> Result<Self, Error> {
        Self::find_in(Path::new(""), scenario)
    }

    /// As [`find`](Self::find), with paths relative to `folder`.
    ///
    /// # Errors
    /// As [`find`](Self::find).
    pub fn find_in(folder: &Path, scenario: &str) -> Result<Self, Error> {
        if let Some(builtin) = builtin::ALL.iter().find(|b| b.name == scenario) {
            return Ok(Self { path: builtin.path.into(), text: builtin.toml.into(), builtin: Some(builtin) });
        }
        let path = folder.join(scenario);
        match std::fs::read_to_string(&path) {
            Ok(text) if text.trim_start().starts_with('<') => Err(Error::Mjcf { file: path }),
            Ok(text) => Ok(Self { path, text: text.into(), builtin: None }),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                let known: Vec<&str> = builtin::ALL.iter().map(|b| b.name).collect();
                Err(Error::Unknown { name: path.display().to_string(), known: known.join(", ") })
            }
            Err(source) => Err(Error::Read { file: path, source }),
        }
    }

    /// Loads the MJCF `model`, relative to the scenario file; built-in ones from memory. `extra` are elements to add to
    /// it, "" for none.
    ///
    /// # Errors
    /// [`Error::Model`] with MuJoCo's own message.
    pub fn load_model(&self, model: &Path, extra: &str) -> Result<Model, Error> {
        let failed = |model: PathBuf| {
            let file = self.path.clone();
            move |source| Error::Model { file, model, source }
        };
        match self.builtin {
            Some(builtin) => {
                let bare = model.file_name().and_then(|n| n.to_str()).unwrap_or_default();
                let xml = builtin.models.iter().find(|(name, _)| *name == bare).map_or("", |(_, text)| text);
                let assets: Vec<(&str, &[u8])> = builtin
                    .models
                    .iter()
                    .filter(|(name, _)| *name != bare)
                    .map(|(n, text)| (*n, text.as_bytes()))
                    .collect();
                let xml = xml.replace("</mujoco>", &format!("{extra}</mujoco>"));
                Model::from_xml_with_assets(&xml, &assets).map_err(failed(model.to_path_buf()))
            }
            None => {
                let path = self.path.parent().unwrap_or(Path::new("")).join(model);
                let absolute = in_absolute_folder(&path);
                if extra.is_empty() {
                    Model::from_xml_file(absolute).map_err(failed(path))
                } else {
                    Model::from_xml_file_with(absolute, extra).map_err(failed(path))
                }
            }
        }
    }
}

/// The same file by an absolute path without `..`: what it includes is found in the same way by every version of MuJoCo, from
/// any working directory. A folder that does not exist stays as it is, to be complained of.
fn in_absolute_folder(path: &Path) -> PathBuf {
    let folder = path.parent().map(|p| if p.as_os_str().is_empty() { Path::new(".") } else { p });
    match (folder.map(Path::canonicalize), path.file_name()) {
        (Some(Ok(folder)), Some(name)) => folder.join(name),
        _ => path.to_path_buf(),
    }
}
