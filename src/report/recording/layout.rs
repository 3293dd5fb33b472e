//! What the viewer shows at first: a row of scenes above a grid of plots.

use re_chunk::TimePoint;
use re_log_types::{BlueprintActivationCommand, EntityPath, LogMsg, TimeInt, Timeline};
use re_sdk_types::blueprint::archetypes::{ContainerBlueprint, ViewBlueprint, ViewContents, ViewportBlueprint};
use re_sdk_types::blueprint::components::{ContainerKind, RootContainer};
use re_sdk_types::datatypes::Uuid;

use super::super::ReportError;
use super::Recording;

/// A part of the viewer's window.
#[derive(Debug, Clone)]
pub struct View {
    name: String,
    origin: String,
    class: &'static str,
}

impl View {
    /// A scene, with what is below the path `origin`.
    pub fn scene(name: &str, origin: &str) -> Self {
        Self { name: name.to_owned(), origin: origin.to_owned(), class: "3D" }
    }

    /// A plot of all series at or below the path `origin`.
    pub fn plot(name: &str, origin: &str) -> Self {
        Self { class: "TimeSeries", ..Self::scene(name, origin) }
    }

    /// A list of the texts at or below the path `origin`.
    pub fn texts(name: &str, origin: &str) -> Self {
        Self { class: "TextLog", ..Self::scene(name, origin) }
    }
}

/// Writes the layout, as the viewer's own "blueprint".
pub(super) fn lay_out(recording: &mut Recording, views: &[View]) -> Result<(), ReportError> {
    recording.open(recording.store.clone());
    let now = TimePoint::default().with(Timeline::new_sequence("blueprint"), TimeInt::ZERO);
    let mut rows = [Vec::new(), Vec::new()];
    for (i, view) in views.iter().enumerate() {
        let path = format!("view/{}", id(i));
        let named = ViewBlueprint::new(view.class).with_display_name(view.name.as_str());
        recording.log(path.as_str().into(), &now, &named.with_space_origin(view.origin.as_str()))?;
        recording.log(format!("{path}/ViewContents").into(), &now, &ViewContents::new(["$origin/**"]))?;
        rows[usize::from(view.class != "3D")].push(path);
    }
    let mut container = |i: usize, kind: ContainerKind, contents: &[String]| {
        let path = format!("container/{}", id(i));
        let contents = ContainerBlueprint::new(kind).with_contents(contents.iter().map(String::as_str));
        recording.log(EntityPath::from(path.as_str()), &now, &contents).map(|()| path)
    };
    let [scenes, plots] = &rows;
    let n = views.len();
    let parts = [container(n, ContainerKind::Horizontal, scenes)?, container(n + 1, ContainerKind::Grid, plots)?];
    container(n + 2, ContainerKind::Vertical, &parts)?;
    let viewport = ViewportBlueprint::new().with_root_container(RootContainer(id(n + 2)));
    recording.log("viewport".into(), &now, &viewport.with_auto_layout(false).with_auto_views(false))?;
    let show = BlueprintActivationCommand::make_active(recording.store.clone());
    recording.messages.push(LogMsg::BlueprintActivationCommand(show));
    Ok(())
}

/// Of the view or container with this number.
fn id(number: usize) -> Uuid {
    Uuid { bytes: (number as u128 + 1).to_be_bytes() }
}
