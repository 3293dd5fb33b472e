//! The scenarios that the program carries with it, so that it runs from any folder.

/// A built-in scenario.
#[derive(Debug)]
pub struct Builtin {
    /// Its name on the command line.
    pub name: &'static str,
    /// Where its file lies in the repository.
    pub path: &'static str,
    /// The scenario file.
    pub toml: &'static str,
    /// File names and texts of the MJCF and all that it includes.
    pub models: &'static [(&'static str, &'static str)],
}

/// The humanoid and what surrounds it, which every built-in model includes.
const HUMANOID: (&str, &str) = ("humanoid.xml", include_str!("../../models/humanoid.xml"));
const STUDIO: (&str, &str) = ("studio.xml", include_str!("../../models/studio.xml"));

/// All built-in scenarios, in the order of `mujoco-grasp list`.
pub const ALL: &[Builtin] = &[Builtin {
    name: "clutch",
    path: "scenarios/clutch.toml",
    toml: include_str!("../../scenarios/clutch.toml"),
    models: &[
        ("clutch.xml", include_str!("../../models/clutch.xml")),
        HUMANOID,
        STUDIO,
    ],
}];
