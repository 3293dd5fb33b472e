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

/// Text of a file of the repository, from `models/`.
macro_rules! model {
    ($file:literal) => {
        ($file, include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/models/", $file)))
    };
}

/// All built-in scenarios, in the order of `mujoco-grasp list`.
pub const ALL: &[Builtin] = &[
    Builtin {
        name: "clutch",
        path: "scenarios/clutch.toml",
        toml: include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/clutch.toml")),
        models: &[model!("clutch.xml"), model!("humanoid.xml"), model!("studio.xml")],
    },
    Builtin {
        name: "pinch",
        path: "scenarios/pinch.toml",
        toml: include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/pinch.toml")),
        models: &[model!("pinch.xml"), model!("humanoid.xml"), model!("studio.xml")],
    },
    Builtin {
        name: "carry",
        path: "scenarios/carry.toml",
        toml: include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/carry.toml")),
        models: &[model!("carry.xml"), model!("humanoid.xml"), model!("studio.xml")],
    },
    Builtin {
        name: "handover",
        path: "scenarios/handover.toml",
        toml: include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/handover.toml")),
        models: &[model!("handover.xml"), model!("studio.xml")],
    },
    Builtin {
        name: "two-hands",
        path: "scenarios/two-hands.toml",
        toml: include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/two-hands.toml")),
        models: &[model!("handover.xml"), model!("studio.xml")],
    },
];
