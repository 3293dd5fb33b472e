//! How far hands, targets and everything else have come since the last whole step, at the most.

use super::Frozen;
use crate::grasp::hand::topology::Topology;
use crate::mujoco::{CompiledModel, JointKind, Simulation};
use nalgebra::Vector3;

impl Frozen {
    /// The largest angle by which a part of a hand or its target has turned against the palm since then \[rad\]. After
    /// [`motion`](Self::motion), for finite ones.
    pub(super) fn turn_in(&self, hand: &Topology) -> f64 {
        let rotation = |dof: Option<usize>| dof.map_or_else(Vector3::zeros, |dof| self.motion[dof].0);
        let palm = rotation(hand.leaf(hand.palm()));
        let dofs = hand.fingers().iter().flatten().copied().map(Some);
        dofs.chain([hand.leaf(hand.target())]).map(|dof| (rotation(dof) - palm).norm()).fold(0.0, f64::max)
    }

    /// How far points of two bodies may have come nearer to each other since the last whole step, at the most \[m\]: what moves
    /// both does not count. After [`motion`](Self::motion).
    pub(super) fn approach(&self, sim: &Simulation, bodies: [usize; 2]) -> f64 {
        let model = sim.model();
        let way = |dof: Option<usize>| dof.map_or(0.0, |dof| self.motion[dof].1);
        let [mut a, mut b] = bodies.map(|body| mover(model, body));
        let both = way(a) + way(b);
        // parents come before their children
        while a != b {
            let deeper = if a > b { &mut a } else { &mut b };
            *deeper = deeper.and_then(|dof| usize::try_from(model.dof_parentid()[dof]).ok());
        }
        both - 2.0 * way(a)
    }

    /// The largest angle and the longest way of anything since the last whole step \[rad, m\]; infinite if one is no number.
    pub(super) fn motion(&mut self, sim: &Simulation) -> (f64, f64) {
        if let Some(moved) = self.moved {
            return moved;
        }
        let moved = self.measure_motion(sim);
        *self.moved.insert(moved)
    }

    fn measure_motion(&mut self, sim: &Simulation) -> (f64, f64) {
        let model = sim.model();
        if self.origin != Some(model.origin()) {
            self.reach = reach(model);
            self.origin = Some(model.origin());
        }
        self.motion.clear();
        let mut largest = (0.0f64, 0.0f64);
        let mut sum = 0.0; // the largest does not see what is no number
        for (dof, (&parent, axis)) in model.dof_parentid().iter().zip(sim.cdof().chunks_exact(6)).enumerate() {
            let parent = usize::try_from(parent).ok().map(|parent| self.motion[parent]);
            let (mut rotation, mut way) = parent.unwrap_or_default();
            rotation += Vector3::new(axis[0], axis[1], axis[2]) * self.travel[dof];
            way += self.travel[dof].abs() * self.reach[dof];
            let angle = rotation.norm();
            largest = (largest.0.max(angle), largest.1.max(way));
            sum += angle + way;
            self.motion.push((rotation, way));
        }
        if sum.is_finite() { largest } else { (f64::INFINITY, f64::INFINITY) }
    }
}

/// The degree of freedom nearest to a body on the way to the world, which moves it.
fn mover(model: &CompiledModel, body: usize) -> Option<usize> {
    let body = model.body_weldid()[body] as usize;
    (model.body_dofnum()[body] > 0).then(|| (model.body_dofadr()[body] + model.body_dofnum()[body] - 1) as usize)
}

/// For each degree of freedom how far the farthest point that it carries is from its axis, at the most; 1 for one that slides.
fn reach(model: &CompiledModel) -> Vec<f64> {
    let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    // of all that hangs on a body and can touch anything, about its origin; negative without such a thing
    let mut radius = vec![f64::NEG_INFINITY; model.nbody()];
    let paired = |geom: usize| model.pair_geom1().iter().chain(model.pair_geom2()).any(|&of| of as usize == geom);
    let touches = |geom: usize| model.geom_contype()[geom] | model.geom_conaffinity()[geom] != 0 || paired(geom);
    for geom in (0..model.ngeom()).filter(|&geom| touches(geom)) {
        let body = model.geom_bodyid()[geom] as usize;
        radius[body] = radius[body].max(norm(&model.geom_pos()[3 * geom..3 * geom + 3]) + model.geom_rbound()[geom]);
    }
    for body in (1..model.nbody()).rev() {
        let parent = model.body_parentid()[body] as usize;
        let mut offset = norm(&model.body_pos()[3 * body..3 * body + 3]);
        let first = model.body_jntadr()[body].max(0) as usize;
        for joint in first..first + model.body_jntnum()[body] as usize {
            offset += 2.0 * norm(&model.jnt_pos()[3 * joint..3 * joint + 3]);
            if model.jnt_type()[joint] == JointKind::Slide.raw() {
                offset += model.jnt_range()[2 * joint..2 * joint + 2].iter().map(|x| x.abs()).fold(0.0, f64::max);
            }
        }
        radius[parent] = radius[parent].max(offset + radius[body]);
    }
    let of = |dof: usize| {
        let joint = model.dof_jntid()[dof] as usize;
        let kind = model.jnt_type()[joint];
        let slides = kind == JointKind::Slide.raw()
            || kind == JointKind::Free.raw() && dof < model.jnt_dofadr()[joint] as usize + 3;
        let body = model.dof_bodyid()[dof] as usize;
        if radius[body] < 0.0 {
            0.0
        } else if slides {
            1.0
        } else {
            radius[body] + norm(&model.jnt_pos()[3 * joint..3 * joint + 3])
        }
    };
    (0..model.nv()).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mujoco::Model;

    #[test]
    fn what_moves_two_bodies_alike_brings_them_no_nearer() {
        let xml = r#"<mujoco><worldbody><body name="arm"><joint axis="0 0 1"/><geom size=".1" pos=".4 0 0"/>
          <body name="a" pos=".5 .1 0"><joint axis="0 0 1"/><geom size=".02"/>
            <body name="nail" pos=".03 0 0"><geom size=".01"/></body></body>
          <body name="b" pos=".5 -.1 0"><joint type="slide"/><geom size=".02"/></body></body></worldbody></mujoco>"#;
        let mut sim = Simulation::new(&Model::from_xml_string(xml).unwrap()).unwrap();
        sim.kinematics().unwrap();
        let mut frozen = Frozen { travel: vec![0.1, 0.02, -0.003], ..Frozen::default() };
        let (angle, way) = frozen.motion(&sim);
        let [arm, a, nail, b] = ["arm", "a", "nail", "b"].map(|name| sim.model().body(name).unwrap().index());
        // the nail's far end is 4 cm from the axis of its finger
        let close = |x: f64, y: f64| (x - y).abs() < 1e-12;
        assert!(close(angle, 0.12) && way > 0.1 * 0.5, "{angle} {way}");
        assert!(close(frozen.approach(&sim, [a, b]), 0.02 * 0.04 + 0.003), "{}", frozen.approach(&sim, [a, b]));
        assert!(close(frozen.approach(&sim, [b, nail]), frozen.approach(&sim, [a, b])));
        assert!(close(frozen.approach(&sim, [arm, nail]), 0.02 * 0.04));
        assert_eq!(frozen.approach(&sim, [a, nail]), 0.0);
        assert!(close(frozen.approach(&sim, [0, a]), way) || close(frozen.approach(&sim, [0, b]), way));
        assert_eq!(frozen.motion(&sim), (angle, way));
        (frozen.travel[1], frozen.moved) = (f64::NAN, None);
        assert_eq!(frozen.motion(&sim), (f64::INFINITY, f64::INFINITY));
        assert!(frozen.approach(&sim, [a, b]).is_nan());
    }
}
