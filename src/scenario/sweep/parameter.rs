//! What can differ from grasp to grasp, by name.

use crate::mujoco::{BodyId, JointKind, Simulation};
use crate::scenario::actuator;
use crate::scenario::plan::Plan;

const KNOWN: &str = "joint:NAME, control:NAME, pose:BODY:x (y, z, qw, qx, qy, qz), friction or strength";

/// Where a value goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Parameter {
    /// An entry of `qpos`.
    Position(usize),
    /// An entry of the starting `ctrl`.
    Control(usize),
    /// An entry of `mocap_pos`.
    MocapPosition(usize),
    /// An entry of `mocap_quat`.
    MocapQuaternion(usize),
    /// Factor on all friction coefficients of the hand's and the target's geoms.
    Friction,
    /// How hard the hand presses, see [`Press`](crate::scenario::press::Press).
    Strength,
}

impl Parameter {
    /// The parameter that `name` means on the scenario's model.
    ///
    /// # Errors
    /// What is wrong with the name, and what would be right.
    pub fn named(plan: &Plan, name: &str) -> Result<Self, String> {
        let model = &plan.model;
        let unknown = |e: crate::mujoco::Error| format!("is unknown: {e}");
        match name.split_once(':') {
            None if name == "friction" => Ok(Self::Friction),
            None if name == "strength" => Ok(Self::Strength),
            Some(("joint", joint)) => {
                let id = model.joint(joint).map_err(unknown)?;
                match model.joint_kind(id) {
                    Some(JointKind::Hinge | JointKind::Slide) => {
                        Ok(Self::Position(model.jnt_qposadr()[id.index()] as usize))
                    }
                    _ => Err(format!(
                        "is no single number: \"{joint}\" is a ball or free joint; give pose:BODY:x and so on"
                    )),
                }
            }
            Some(("control", actuator)) => {
                Ok(Self::Control(actuator::named(model, actuator).map_err(unknown)?.index()))
            }
            Some(("pose", pose)) => {
                let components = ["x", "y", "z", "qw", "qx", "qy", "qz"];
                let parts = pose.rsplit_once(':');
                let Some((body, k)) =
                    parts.and_then(|(body, c)| Some((body, components.iter().position(|known| *known == c)?)))
                else {
                    return Err("names no component of a pose; give pose:BODY:x, y, z, qw, qx, qy or qz".into());
                };
                component(plan, model.body(body).map_err(unknown)?, k)
                    .ok_or_else(|| format!("cannot be set: \"{body}\" has no free joint and is no mocap body"))
            }
            _ => Err(format!("is no parameter; those are {KNOWN}")),
        }
    }

    /// Puts a value in its place, at the start of a scenario. [`Strength`](Self::Strength) has none.
    pub fn set(self, sim: &mut Simulation, geoms: &[usize], value: f64) {
        match self {
            Self::Position(i) => sim.qpos_mut()[i] = value,
            Self::Control(i) => sim.ctrl_mut()[i] = value,
            Self::MocapPosition(i) => sim.mocap_pos_mut()[i] = value,
            Self::MocapQuaternion(i) => sim.mocap_quat_mut()[i] = value,
            Self::Friction => {
                for &geom in geoms {
                    sim.geom_friction_mut()[3 * geom..3 * geom + 3].iter_mut().for_each(|x| *x *= value);
                }
            }
            Self::Strength => {}
        }
    }
}

/// Component `k` of the pose of a body that floats or that mocap moves.
fn component(plan: &Plan, body: BodyId, k: usize) -> Option<Parameter> {
    if let Some(joint) = plan.model.free_joint_of(body) {
        return Some(Parameter::Position(plan.model.jnt_qposadr()[joint.index()] as usize + k));
    }
    let mocap = usize::try_from(plan.model.body_mocapid()[body.index()]).ok()?;
    Some(if k < 3 { Parameter::MocapPosition(3 * mocap + k) } else { Parameter::MocapQuaternion(4 * mocap + k - 3) })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::mujoco::Model;
    use crate::scenario::file::ScenarioFile;

    const MODEL: &str = r#"<mujoco>
      <worldbody>
        <body name="mocap" mocap="true"><geom size="0.01" contype="0" conaffinity="0"/></body>
        <body name="palm" pos="0 0 1">
          <joint name="turn"/>
          <geom size="0.02" friction="0.8 0.1 0.01"/>
          <body name="finger" pos="0 0.1 0"><joint name="slide" type="slide"/><geom size="0.02"/></body>
        </body>
        <body name="ball"><freejoint name="free"/><geom size="0.02" friction="0.6 0.2 0.02"/></body>
        <geom name="floor" type="plane" size="1 1 0.1" pos="0 0 -1"/>
      </worldbody>
      <actuator><position name="press" joint="slide"/></actuator>
    </mujoco>"#;
    const SCENARIO: &str =
        "name = \"s\"\nmodel = \"m\"\n[timeline]\nduration = 1.0\n[[grasp]]\ntarget = \"ball\"\npalm = \"palm\"";

    fn plan() -> Plan {
        let path = Path::new("s.toml");
        Plan::new(&ScenarioFile::parse(SCENARIO, path).unwrap(), path, Model::from_xml_string(MODEL).unwrap()).unwrap()
    }

    #[test]
    fn each_name_has_its_place() {
        let plan = plan();
        let mut sim = Simulation::new(&plan.model).unwrap();
        let before = plan.model.geom_friction().to_vec();
        // mocap, palm, finger, ball, floor: those of hand and target
        let geoms = [1, 2, 3];
        for (name, value) in [
            ("joint:turn", 0.1),
            ("joint:slide", 0.2),
            ("control:press", 0.3),
            ("pose:ball:y", 0.4),
            ("pose:ball:qz", 0.5),
            ("pose:mocap:z", 0.6),
            ("pose:mocap:qx", 0.7),
            ("friction", 2.0),
        ] {
            Parameter::named(&plan, name).unwrap().set(&mut sim, &geoms, value);
        }
        assert_eq!(sim.qpos(), [0.1, 0.2, 0.0, 0.4, 0.0, 1.0, 0.0, 0.0, 0.5]);
        assert_eq!(sim.ctrl(), [0.3]);
        assert_eq!((sim.mocap_pos(), sim.mocap_quat()), (&[0.0, 0.0, 0.6][..], &[1.0, 0.7, 0.0, 0.0][..]));
        let world = plan.model.geom_bodyid().iter().position(|body| *body == 0).unwrap();
        for (geom, (new, old)) in sim.model().geom_friction().chunks(3).zip(before.chunks(3)).enumerate() {
            let expected = if geoms.contains(&geom) { 2.0 } else { 1.0 };
            assert!(new.iter().zip(old).all(|(new, old)| *new == expected * old), "geom {geom}");
        }
        assert!(!geoms.contains(&world), "{world}");
    }

    #[test]
    fn a_wrong_name_is_told_what_would_be_right() {
        let plan = plan();
        for (name, problem) in [
            ("joint:tern", "turn"),
            ("joint:free", "pose:BODY:x"),
            ("control:pres", "press"),
            ("pose:ball:w", "qw"),
            ("pose:finger:x", "no free joint"),
            ("frictoin", "friction or strength"),
            ("mass:ball", "is no parameter"),
        ] {
            let said = Parameter::named(&plan, name).unwrap_err();
            assert!(said.contains(problem), "{name}: {said}");
        }
    }
}
