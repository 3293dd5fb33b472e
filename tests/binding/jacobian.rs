//! Jacobians, the inertia matrix and forces against finite differences and closed forms.

use mujoco_grasp::mujoco::{BodyId, Model, Simulation};
use nalgebra::{DMatrix, DVector, Vector3, Vector6};

const ARM: &str = r#"<mujoco><option gravity="0 0 0"/><worldbody>
  <body name="base"><joint axis="0 0 1"/><geom size=".1" mass="2"/>
    <body name="upper" pos=".3 0 .1"><joint axis="0 1 0"/><joint type="slide" axis="1 0 0"/><geom size=".05" pos=".1 .02 0" mass="1"/>
      <body name="hand" pos=".2 0 .1" euler="20 30 40"><joint type="ball"/><geom name="g" type="box" size=".02 .03 .04" pos="0 .05 0" mass=".5"/><site name="s" pos="0 0 .1"/></body></body></body>
  <body name="cube" pos="1 1 1"><freejoint/><geom type="box" size=".1 .2 .3" mass="3"/></body>
</worldbody></mujoco>"#;

/// At a configuration without symmetry, with everything computed.
fn bent() -> Simulation {
    let mut sim = Simulation::new(&Model::from_xml_string(ARM).unwrap()).unwrap();
    let velocity: Vec<f64> = (0..sim.model().nv()).map(|i| 0.4 + (i as f64).sin()).collect();
    let mut start = sim.qpos().to_vec();
    advance(&sim, &mut start, &velocity, 1.0);
    sim.qpos_mut().copy_from_slice(&start);
    sim.qvel_mut().copy_from_slice(&velocity);
    sim.forward().unwrap();
    sim
}

/// `qpos` after `time` at constant `qvel`, for this model's joints.
fn advance(sim: &Simulation, qpos: &mut [f64], qvel: &[f64], time: f64) {
    let model = sim.model();
    for joint in model.joints() {
        let (q, v) = (model.jnt_qposadr()[joint.index()] as usize, model.jnt_dofadr()[joint.index()] as usize);
        let rotate = |quat: &mut [f64], w: &[f64]| {
            let turn = nalgebra::UnitQuaternion::from_scaled_axis(Vector3::from_column_slice(w) * time);
            let old = nalgebra::Quaternion::new(quat[0], quat[1], quat[2], quat[3]);
            let new = nalgebra::UnitQuaternion::from_quaternion(old) * turn;
            quat.copy_from_slice(&[new.w, new.i, new.j, new.k]);
        };
        match model.jnt_type()[joint.index()] {
            0 => {
                (0..3).for_each(|i| qpos[q + i] += time * qvel[v + i]);
                rotate(&mut qpos[q + 3..q + 7], &qvel[v + 3..v + 6]);
            }
            1 => rotate(&mut qpos[q..q + 4], &qvel[v..v + 3]),
            _ => qpos[q] += time * qvel[v],
        }
    }
}

/// Twist of a point fixed in `body` by central differences along degree of freedom `dof`.
fn finite_twist(sim: &Simulation, body: BodyId, point: &Vector3<f64>, dof: usize) -> Vector6<f64> {
    const STEP: f64 = 1e-6;
    let local = sim.body_rotation(body).transpose() * (point - sim.body_position(body));
    let mut unit = vec![0.0; sim.model().nv()];
    unit[dof] = 1.0;
    let [minus, plus] = [-STEP, STEP].map(|time| {
        let mut moved = sim.clone();
        let mut qpos = sim.qpos().to_vec();
        advance(sim, &mut qpos, &unit, time);
        moved.qpos_mut().copy_from_slice(&qpos);
        moved.kinematics().unwrap();
        (moved.body_position(body) + moved.body_rotation(body) * local, moved.body_rotation(body))
    });
    let linear = (plus.0 - minus.0) / (2.0 * STEP);
    let turn = plus.1 * minus.1.transpose();
    let angular = Vector3::new(turn.m32 - turn.m23, turn.m13 - turn.m31, turn.m21 - turn.m12) / (4.0 * STEP);
    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}

#[test]
fn jacobians_are_the_derivatives_of_the_kinematics() {
    let sim = bent();
    let nv = sim.model().nv();
    let hand = sim.model().body("hand").unwrap();
    let cube = sim.model().body("cube").unwrap();
    let site = sim.model().site("s").unwrap();
    let geom = sim.model().geom("g").unwrap();
    let mut rows = vec![0.0; 6 * nv];
    type Jac<'a> = Box<dyn Fn(&mut [f64]) + 'a>;
    let offset = Vector3::new(0.1, -0.2, 0.3);
    let cases: [(BodyId, Vector3<f64>, Jac); 6] = [
        (hand, sim.body_position(hand), Box::new(|out| sim.jac_body(hand, out).unwrap())),
        (hand, sim.body_com(hand), Box::new(|out| sim.jac_body_com(hand, out).unwrap())),
        (hand, sim.site_position(site), Box::new(|out| sim.jac_site(site, out).unwrap())),
        (hand, sim.geom_position(geom), Box::new(|out| sim.jac_geom(geom, out).unwrap())),
        (hand, offset, Box::new(|out| sim.jac_point(hand, &offset, out).unwrap())),
        (cube, offset, Box::new(|out| sim.jac_point(cube, &offset, out).unwrap())),
    ];
    for (case, (body, point, jacobian)) in cases.iter().enumerate() {
        jacobian(&mut rows);
        let exact = DMatrix::from_row_slice(6, nv, &rows);
        for dof in 0..nv {
            let error = (exact.column(dof) - finite_twist(&sim, *body, point, dof)).norm();
            assert!(error < 1e-8, "case {case}, dof {dof}: {error}");
        }
    }
    let matrix = sim.point_jacobian(hand, &offset).unwrap();
    sim.jac_point(hand, &offset, &mut rows).unwrap();
    assert_eq!(matrix, DMatrix::from_row_slice(6, nv, &rows));
}

#[test]
fn twists_are_jacobians_times_velocities() {
    let sim = bent();
    let qvel = DVector::from_column_slice(sim.qvel());
    for body in ["hand", "cube"].map(|name| sim.model().body(name).unwrap()) {
        let frame = sim.point_jacobian(body, &sim.body_position(body)).unwrap() * &qvel;
        assert!((frame - sim.body_twist(body).unwrap()).norm() < 1e-12);
        let com = sim.point_jacobian(body, &sim.body_com(body)).unwrap() * &qvel;
        assert!((com - sim.body_com_twist(body).unwrap()).norm() < 1e-12);
    }
}

#[test]
fn the_inertia_matrix_gives_the_kinetic_energy_of_the_bodies() {
    let mut sim = bent();
    let mass = sim.full_mass_matrix().unwrap();
    assert_eq!(mass, mass.transpose());
    let qvel = DVector::from_column_slice(sim.qvel());
    // Independent of the engine's composite inertia: the sum over bodies of m v^2 / 2 + w I w / 2.
    let bodies: f64 = (1..sim.model().nbody())
        .map(|i| {
            let body = BodyId::from_index(i);
            let twist = sim.body_com_twist(body).unwrap();
            let (v, w) = (twist.fixed_rows::<3>(0), twist.fixed_rows::<3>(3));
            0.5 * sim.model().body_mass()[i] * v.norm_squared() + 0.5 * w.dot(&(sim.body_inertia_world(body) * w))
        })
        .sum();
    let energy = 0.5 * qvel.dot(&(&mass * &qvel));
    assert!((energy - bodies).abs() < 1e-12 * bodies, "{energy} {bodies}");
    sim.set_energy_enabled(true);
    sim.energy_vel().unwrap();
    assert!((sim.energy()[1] - bodies).abs() < 1e-12 * bodies);

    let mut product = vec![0.0; qvel.len()];
    sim.mul_mass(qvel.as_slice(), &mut product).unwrap();
    assert!((DVector::from_column_slice(&product) - &mass * &qvel).norm() < 1e-12);
    sim.solve_mass(&mut product).unwrap();
    assert!((DVector::from_vec(product) - &qvel).norm() < 1e-10);
    // Two vectors at once.
    let mut two = [qvel.as_slice(), qvel.as_slice()].concat();
    sim.solve_mass(&mut two).unwrap();
    assert_eq!(two[..qvel.len()], two[qvel.len()..]);
    assert!((mass * DVector::from_column_slice(&two[..qvel.len()]) - qvel).norm() < 1e-10);
}

#[test]
fn forces_on_a_free_body_accelerate_it_as_newton_says() {
    let mut sim = bent();
    sim.qvel_mut().fill(0.0);
    let cube = sim.model().body("cube").unwrap();
    let (force, torque) = (Vector3::new(3.0, -6.0, 9.0), Vector3::new(0.1, 0.2, -0.3));
    let inertia = sim.body_inertia_world(cube);
    let dof = sim.model().body_dofadr()[cube.index()] as usize;
    let check = |sim: &mut Simulation, moment: Vector3<f64>| {
        sim.forward().unwrap();
        // A free joint: linear acceleration in world axes, angular in body axes.
        let linear = Vector3::from_column_slice(&sim.qacc()[dof..dof + 3]);
        let angular = sim.body_rotation(cube) * Vector3::from_column_slice(&sim.qacc()[dof + 3..dof + 6]);
        assert!((linear - force / 3.0).norm() < 1e-12);
        assert!((inertia * angular - moment).norm() < 1e-12);
    };
    // The same wrench in three ways: at the centre of mass, at a point, and as a generalized force of the caller's.
    sim.set_body_wrench(cube, &force, &torque).unwrap();
    assert_eq!(sim.body_wrench(cube).unwrap().as_slice(), [3.0, -6.0, 9.0, 0.1, 0.2, -0.3]);
    check(&mut sim, torque);
    sim.clear_body_wrenches();
    let point = Vector3::new(0.3, 0.2, 0.1);
    let moment = torque + (point - sim.body_com(cube)).cross(&force);
    sim.apply_force_at(cube, &force, &torque, &point).unwrap();
    check(&mut sim, moment);
    let applied = sim.qfrc_applied().to_vec();
    sim.qfrc_applied_mut().fill(0.0);
    let mut own = vec![1.0; applied.len()];
    sim.add_generalized_force(cube, &force, &torque, &point, &mut own).unwrap();
    assert!(own.iter().zip(&applied).all(|(own, applied)| (own - 1.0 - applied).abs() < 1e-12), "it adds");
}
