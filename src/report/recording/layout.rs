//! What the viewer shows at first: a row of scenes above a grid of plots.

use re_chunk::TimePoint;
use re_log_types::{BlueprintActivationCommand, EntityPath, LogMsg, TimeInt, Timeline};
use re_sdk_types::blueprint::archetypes::{
    ContainerBlueprint, EyeControls3D, PanelBlueprint, PlotLegend, TimePanelBlueprint, ViewBlueprint, ViewContents,
    ViewportBlueprint,
};
use re_sdk_types::blueprint::components::{ContainerKind, PanelState, RootContainer};
use re_sdk_types::datatypes::Uuid;

use super::super::ReportError;
use super::Recording;

/// Plots side by side.
const COLUMNS: u32 = 3;

/// A part of the viewer's window.
#[derive(Debug, Clone)]
pub struct View {
    name: String,
    origin: String,
    class: &'static str,
    /// Where the eye is, and what it looks at.
    eye: Option<[[f32; 3]; 2]>,
    legend: bool,
}

impl View {
    /// A scene, with what is below the path `origin`.
    pub fn scene(name: &str, origin: &str) -> Self {
        Self { name: name.to_owned(), origin: origin.to_owned(), class: "3D", eye: None, legend: true }
    }

    /// A plot of all series at or below the path `origin`.
    pub fn plot(name: &str, origin: &str) -> Self {
        Self { class: "TimeSeries", ..Self::scene(name, origin) }
    }

    /// The scene is seen from a point, with another in the middle \[m\]; else from where all of it is seen, with all of the floor.
    pub fn seen_from(self, from: [f64; 3], at: [f64; 3]) -> Self {
        Self { eye: Some([from, at].map(|point| point.map(|x| x as f32))), ..self }
    }

    /// A plot without a legend: where there are many series it would cover them.
    pub fn without_legend(self) -> Self {
        Self { legend: false, ..self }
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
        if let Some([from, at]) = view.eye {
            let eye = EyeControls3D::new().with_position(from).with_look_target(at).with_eye_up([0.0, 0.0, 1.0]);
            recording.log(format!("{path}/EyeControls3D").into(), &now, &eye)?;
        }
        if !view.legend {
            recording.log(format!("{path}/PlotLegend").into(), &now, &PlotLegend::new().with_visible(false))?;
        }
        rows[usize::from(view.class != "3D")].push(path);
    }
    let mut container = |i: usize, kind: ContainerKind, contents: &[String]| {
        let path = format!("container/{}", id(i));
        let mut container = ContainerBlueprint::new(kind).with_contents(contents.iter().map(String::as_str));
        if kind == ContainerKind::Grid {
            // Left to itself the viewer makes one row of six.
            container = container.with_grid_columns(COLUMNS);
        }
        recording.log(EntityPath::from(path.as_str()), &now, &container).map(|()| path)
    };
    let [scenes, plots] = &rows;
    let n = views.len();
    let parts = [container(n, ContainerKind::Horizontal, scenes)?, container(n + 1, ContainerKind::Grid, plots)?];
    container(n + 2, ContainerKind::Vertical, &parts)?;
    // The room is for what is to be seen; a click opens them.
    for panel in ["blueprint_panel", "selection_panel"] {
        recording.log(panel.into(), &now, &PanelBlueprint::new().with_state(PanelState::Collapsed))?;
    }
    recording.log("time_panel".into(), &now, &TimePanelBlueprint::new().with_state(PanelState::Collapsed))?;
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
