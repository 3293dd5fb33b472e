//! The keys of the window.

use winit::keyboard::{Key, NamedKey};

/// What a key does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Command {
    Pause,
    Step,
    Slower,
    Faster,
    Reset,
    Mode,
    Contacts,
    Forces,
    Tint,
    Bars,
    Plot,
    Shadows,
    Home,
    Picture,
    Keys,
    Quit,
}

/// Keys and mouse, and what they do: for the screen and the documentation.
pub const KEYS: [(&str, &str); 23] = [
    ("Space", "pause, go on"),
    ("Right", "one step, paused"),
    ("-  =", "slower, faster"),
    ("Backspace", "reset"),
    ("M", "full or grasp mode"),
    ("C", "contacts and cones"),
    ("F", "contact forces"),
    ("T", "tint of the grasp"),
    ("B", "friction over limits"),
    ("G", "quality and phase"),
    ("S", "shadows"),
    ("Esc", "camera as at first"),
    ("P", "save a picture"),
    ("F1", "these keys"),
    ("Q", "quit"),
    ("left drag", "orbit"),
    ("right drag", "pan"),
    ("wheel", "zoom"),
    ("double left", "select a body"),
    ("double right", "look there"),
    ("Ctrl right drag", "force on it"),
    ("Ctrl left drag", "torque on it"),
    ("Shift", "horizontally"),
];

/// The key's command, if it has one.
pub(super) fn command(key: &Key) -> Option<Command> {
    Some(match key {
        Key::Named(NamedKey::Space) => Command::Pause,
        Key::Named(NamedKey::ArrowRight) => Command::Step,
        Key::Named(NamedKey::Backspace) => Command::Reset,
        Key::Named(NamedKey::Escape) => Command::Home,
        Key::Named(NamedKey::F1) => Command::Keys,
        Key::Character(text) => match text.to_ascii_lowercase().as_str() {
            "-" => Command::Slower,
            "=" | "+" => Command::Faster,
            "m" => Command::Mode,
            "c" => Command::Contacts,
            "f" => Command::Forces,
            "t" => Command::Tint,
            "b" => Command::Bars,
            "g" => Command::Plot,
            "s" => Command::Shadows,
            "p" => Command::Picture,
            "q" => Command::Quit,
            _ => return None,
        },
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_on_the_screen_does_something_and_each_something_else() {
        let named = |name: &str| match name {
            "Space" => Key::Named(NamedKey::Space),
            "Right" => Key::Named(NamedKey::ArrowRight),
            "Backspace" => Key::Named(NamedKey::Backspace),
            "Esc" => Key::Named(NamedKey::Escape),
            "F1" => Key::Named(NamedKey::F1),
            letter => Key::Character(letter.into()),
        };
        let keys = KEYS.iter().take_while(|(key, _)| *key != "left drag").flat_map(|(key, _)| key.split_whitespace());
        let commands: Vec<Command> =
            keys.map(|key| command(&named(key)).unwrap_or_else(|| panic!("{key} does nothing"))).collect();
        for (i, one) in commands.iter().enumerate() {
            assert!(!commands[..i].contains(one), "{one:?} has two keys");
        }
        // as many as there are, the last being `Quit`
        assert_eq!(commands.len(), Command::Quit as usize + 1);
    }

    /// The engine cuts an overlay after 500 characters.
    #[test]
    fn the_list_fits_the_screen() {
        for column in [KEYS.map(|(key, _)| key), KEYS.map(|(_, what)| what)] {
            assert!(column.join("\n").len() < 500);
        }
    }
}
