//! The links between a palm and some fingertips: forward kinematics and point Jacobians in the palm's frame.

use nalgebra::{Isometry3, Quaternion, Translation3, Unit, UnitQuaternion, Vector3};

use super::Error;
use crate::mujoco::{BodyId, JointId, Simulation, SiteId};

/// mjJNT_SLIDE and mjJNT_HINGE.
const SLIDE: i32 = 2;
const HINGE: i32 = 3;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Slide,
    Hinge,
}

/// A scalar joint.
#[derive(Clone, Debug)]
pub(super) struct Joint {
    pub(super) id: JointId,
    kind: Kind,
    /// In the frame of its body.
    axis: Unit<Vector3<f64>>,
    anchor: Vector3<f64>,
    /// qpos0: the value in the pose that the model is written in.
    reference: f64,
    pub(super) lower: f64,
    pub(super) upper: f64,
    /// Whether a solve may move it.
    pub(super) free: bool,
    address: usize,
}

#[derive(Clone, Debug)]
struct Link {
    /// `None`: the palm.
    parent: Option<usize>,
    /// In the parent's frame, with its joints at their reference.
    pose: Isometry3<f64>,
    joints: std::ops::Range<usize>,
}

#[derive(Clone, Debug)]
struct Tip {
    link: Option<usize>,
    /// In the link's frame.
    point: Vector3<f64>,
    /// Free joints between the palm and the tip.
    path: Vec<usize>,
}

/// Links from the palm outwards, parents first.
#[derive(Clone, Debug)]
pub(super) struct Chain {
    links: Vec<Link>,
    pub(super) joints: Vec<Joint>,
    tips: Vec<Tip>,
    // The last forward pass, in the palm's frame.
    poses: Vec<Isometry3<f64>>,
    axes: Vec<Vector3<f64>>,
    anchors: Vec<Vector3<f64>>,
    points: Vec<Vector3<f64>>,
}

/// Bodies from below the palm to the body of `site`, outwards.
fn bodies_between(sim: &Simulation, palm: BodyId, site: SiteId) -> Result<Vec<usize>, Error> {
    let model = sim.model();
    let mut body = *model.site_bodyid().get(site.index()).ok_or_else(|| not_below(sim, palm, site))? as usize;
    let mut bodies = Vec::new();
    while body != palm.index() {
        if body == 0 {
            return Err(not_below(sim, palm, site));
        }
        bodies.push(body);
        body = model.body_parentid()[body] as usize;
    }
    bodies.reverse();
    Ok(bodies)
}

fn not_below(sim: &Simulation, palm: BodyId, site: SiteId) -> Error {
    Error::NotBelow { site: site_name(sim, site), palm: body_name(sim, palm) }
}

pub(super) fn site_name(sim: &Simulation, site: SiteId) -> String {
    sim.model().site_name(site).map_or_else(|| format!("site {}", site.index()), str::to_owned)
}

pub(super) fn body_name(sim: &Simulation, body: BodyId) -> String {
    sim.model().body_name(body).map_or_else(|| format!("body {}", body.index()), str::to_owned)
}

/// Joints of `body`.
fn joints_of(sim: &Simulation, body: usize) -> std::ops::Range<usize> {
    let model = sim.model();
    let (address, count) = (model.body_jntadr()[body], model.body_jntnum()[body]);
    if address < 0 { 0..0 } else { address as usize..(address + count) as usize }
}

/// Joints between the palm and a site, outwards.
pub(super) fn joints_between(sim: &Simulation, palm: BodyId, site: SiteId) -> Result<Vec<JointId>, Error> {
    let bodies = bodies_between(sim, palm, site)?;
    Ok(bodies.into_iter().flat_map(|b| joints_of(sim, b)).map(JointId::from_index).collect())
}

fn vector(array: &[f64], index: usize) -> Vector3<f64> {
    Vector3::from_column_slice(&array[3 * index..3 * index + 3])
}

fn quaternion(array: &[f64], index: usize) -> UnitQuaternion<f64> {
    let q = &array[4 * index..4 * index + 4];
    UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]))
}

impl Chain {
    pub(super) fn new(sim: &Simulation, palm: BodyId, sites: &[SiteId], free: &[JointId]) -> Result<Self, Error> {
        let model = sim.model();
        let paths = sites.iter().map(|&s| bodies_between(sim, palm, s)).collect::<Result<Vec<_>, _>>()?;
        let mut bodies: Vec<usize> = paths.iter().flatten().copied().collect();
        // MuJoCo numbers parents before children.
        bodies.sort_unstable();
        bodies.dedup();
        let mut joints = Vec::new();
        let mut links = Vec::new();
        for &body in &bodies {
            let first = joints.len();
            for j in joints_of(sim, body) {
                let id = JointId::from_index(j);
                let kind = match model.jnt_type()[j] {
                    SLIDE => Kind::Slide,
                    HINGE => Kind::Hinge,
                    _ => {
                        let joint = model.joint_name(id).map_or_else(|| format!("joint {j}"), str::to_owned);
                        return Err(Error::Joint { joint });
                    }
                };
                let address = model.jnt_qposadr()[j] as usize;
                let limited = model.jnt_limited()[j] != 0;
                let range = &model.jnt_range()[2 * j..2 * j + 2];
                joints.push(Joint {
                    id,
                    kind,
                    axis: Unit::new_normalize(vector(model.jnt_axis(), j)),
                    anchor: vector(model.jnt_pos(), j),
                    reference: model.qpos0()[address],
                    lower: if limited { range[0] } else { f64::NEG_INFINITY },
                    upper: if limited { range[1] } else { f64::INFINITY },
                    free: free.contains(&id),
                    address,
                });
            }
            let parent = model.body_parentid()[body] as usize;
            links.push(Link {
                parent: bodies.binary_search(&parent).ok(),
                pose: Isometry3::from_parts(
                    Translation3::from(vector(model.body_pos(), body)),
                    quaternion(model.body_quat(), body),
                ),
                joints: first..joints.len(),
            });
        }
        let tips: Vec<Tip> = sites
            .iter()
            .zip(&paths)
            .map(|(site, path)| Tip {
                link: path.last().and_then(|b| bodies.binary_search(b).ok()),
                point: vector(model.site_pos(), site.index()),
                path: path
                    .iter()
                    .filter_map(|b| bodies.binary_search(b).ok())
                    .flat_map(|l| links[l].joints.clone())
                    .filter(|&j| joints[j].free)
                    .collect(),
            })
            .collect();
        Ok(Self {
            poses: vec![Isometry3::identity(); links.len()],
            axes: vec![Vector3::zeros(); joints.len()],
            anchors: vec![Vector3::zeros(); joints.len()],
            points: vec![Vector3::zeros(); tips.len()],
            links,
            joints,
            tips,
        })
    }

    /// Indices of the joints that a solve may move.
    pub(super) fn free(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.joints.len()).filter(|&j| self.joints[j].free)
    }

    pub(super) fn free_joints(&self) -> impl Iterator<Item = JointId> + '_ {
        self.free().map(|j| self.joints[j].id)
    }

    /// Free joints between the palm and a tip.
    pub(super) fn path(&self, tip: usize) -> &[usize] {
        &self.tips[tip].path
    }

    /// Reads every joint, the free ones moved into their limits.
    pub(super) fn read(&self, sim: &Simulation, q: &mut [f64]) {
        for (q, joint) in q.iter_mut().zip(&self.joints) {
            let value = sim.qpos()[joint.address];
            *q = if joint.free { value.clamp(joint.lower, joint.upper) } else { value };
        }
    }

    /// Poses of links, axes and anchors of joints and points of tips for the joint values `q`, as mj_kinematics computes
    /// them, but in the palm's frame.
    pub(super) fn forward(&mut self, q: &[f64]) {
        for (l, link) in self.links.iter().enumerate() {
            let mut pose = match link.parent {
                Some(parent) => self.poses[parent] * link.pose,
                None => link.pose,
            };
            for j in link.joints.clone() {
                let joint = &self.joints[j];
                let anchor = pose.transform_point(&joint.anchor.into()).coords;
                let axis = pose.rotation * joint.axis;
                self.anchors[j] = anchor;
                self.axes[j] = axis.into_inner();
                let value = q[j] - joint.reference;
                match joint.kind {
                    Kind::Slide => pose.translation.vector += value * axis.into_inner(),
                    Kind::Hinge => {
                        pose.rotation *= UnitQuaternion::from_axis_angle(&joint.axis, value);
                        // The body turns about the anchor, which stays where it is.
                        pose.translation.vector = anchor - pose.rotation * joint.anchor;
                    }
                }
            }
            self.poses[l] = pose;
        }
        for (point, tip) in self.points.iter_mut().zip(&self.tips) {
            *point = match tip.link {
                Some(link) => self.poses[link].transform_point(&tip.point.into()).coords,
                None => tip.point,
            };
        }
    }

    /// Where a tip is after the last forward pass.
    pub(super) fn point(&self, tip: usize) -> Vector3<f64> {
        self.points[tip]
    }

    /// Velocity of a tip for a unit velocity of a joint on its path.
    pub(super) fn column(&self, tip: usize, joint: usize) -> Vector3<f64> {
        match self.joints[joint].kind {
            Kind::Slide => self.axes[joint],
            Kind::Hinge => self.axes[joint].cross(&(self.points[tip] - self.anchors[joint])),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mujoco::Model;

    /// A hinge, a slide and a hinge whose anchors and axes are in no special place.
    const XML: &str = r#"<mujoco><compiler angle="radian"/><worldbody><body name="palm" euler="1 2 3">
        <geom size="0.01"/>
        <body name="a" pos="0.1 0.2 0.3" euler="0.3 0.2 0.1">
          <joint name="h1" axis="1 2 3" pos="0.01 0.02 -0.03" ref="0.2"/>
          <joint name="s" type="slide" axis="-1 1 0.5"/><geom size="0.01"/>
          <body name="b" pos="0 0.1 0.05"><joint name="h2" axis="0 1 -1" pos="0 0.03 0"/><geom size="0.01"/>
            <site name="tip" pos="0.05 0.02 0.1"/></body></body></body></worldbody></mujoco>"#;

    #[test]
    fn jacobian_is_the_derivative_of_the_point() {
        let sim = Simulation::new(&Model::from_xml_string(XML).unwrap()).unwrap();
        let model = sim.model();
        let (palm, tip) = (model.body("palm").unwrap(), model.site("tip").unwrap());
        let joints: Vec<JointId> = model.joints().collect();
        let mut chain = Chain::new(&sim, palm, &[tip], &joints).unwrap();
        assert_eq!(chain.path(0), [0, 1, 2]);
        let q = [0.7, -0.1, 0.4];
        chain.forward(&q);
        let columns: Vec<Vector3<f64>> = (0..3).map(|j| chain.column(0, j)).collect();
        let eps = 1e-6;
        for (j, column) in columns.iter().enumerate() {
            let mut at = |by: f64| {
                let mut moved = q;
                moved[j] += by;
                chain.forward(&moved);
                chain.point(0)
            };
            let difference = (at(eps) - at(-eps)) / (2.0 * eps);
            assert!((difference - column).norm() < 1e-9, "joint {j}: {difference} and {column}");
        }
    }

    #[test]
    fn joints_that_may_not_move_are_in_no_path() {
        let sim = Simulation::new(&Model::from_xml_string(XML).unwrap()).unwrap();
        let model = sim.model();
        let (palm, tip) = (model.body("palm").unwrap(), model.site("tip").unwrap());
        let chain = Chain::new(&sim, palm, &[tip], &[model.joint("h2").unwrap()]).unwrap();
        assert_eq!(chain.path(0), [2]);
        assert_eq!(chain.joints.len(), 3);
    }
}
