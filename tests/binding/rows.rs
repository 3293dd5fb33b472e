//! Reading and rewriting constraint rows: an equality with force limits.

use mujoco_grasp::mujoco::{Error, JacobianStorage, Model, RowKind, RowState, Simulation, Solver};

/// Two free cubes without gravity, welded, far from everything; a floor with a ball makes other rows.
const PAIR: &str = r#"<mujoco><option gravity="0 0 -9.81" iterations="200" tolerance="1e-14"/><worldbody>
  <geom type="plane" size="5 5 1"/><body pos="3 0 .0999"><freejoint/><geom size=".1"/></body>
  <body name="shelf" pos="0 0 2"><joint name="j" type="slide" axis="0 0 1" frictionloss="500" solimpfriction="0.9999 0.9999 0.001"/><geom type="box" size=".1 .1 .1" mass="1" contype="0" conaffinity="0"/></body>
  <body name="cube" pos="0 0 1.5"><freejoint/><geom type="box" size=".1 .1 .1" mass="2" contype="0" conaffinity="0"/></body>
  </worldbody><equality><weld name="w" body1="shelf" body2="cube" solref="0.005 1" solimp="0.9999 0.9999 0.001"/></equality></mujoco>"#;

const WEIGHT: f64 = 2.0 * 9.81;

fn pair(solver: Solver, storage: JacobianStorage) -> Simulation {
    let mut sim = Simulation::new(&Model::from_xml_string(PAIR).unwrap()).unwrap();
    sim.set_solver(solver).unwrap();
    sim.set_jacobian_storage(storage).unwrap();
    sim
}

/// A step in which the weld's rows get force limits, between making the rows and projecting them.
fn step_with_limit(sim: &mut Simulation, limit: f64) {
    sim.kinematics().unwrap();
    sim.inertia().unwrap();
    sim.collision().unwrap();
    sim.make_constraint().unwrap();
    let rows = sim.make_friction_rows(6).unwrap();
    assert_eq!((rows.clone(), sim.ne()), (0..6, 0));
    for row in rows {
        assert_eq!(sim.constraint_row(row).unwrap().kind, RowKind::FrictionDof);
        sim.set_row_friction_limit(row, limit).unwrap();
    }
    sim.transmission().unwrap();
    sim.project_constraint().unwrap();
    sim.velocity().unwrap();
    sim.actuation().unwrap();
    sim.acceleration().unwrap();
    sim.constraint().unwrap();
    sim.rne_post_constraint().unwrap();
}

const CASES: [(Solver, JacobianStorage); 6] = [
    (Solver::Newton, JacobianStorage::Dense),
    (Solver::Newton, JacobianStorage::Sparse),
    (Solver::Cg, JacobianStorage::Dense),
    (Solver::Cg, JacobianStorage::Sparse),
    (Solver::Pgs, JacobianStorage::Dense),
    (Solver::Pgs, JacobianStorage::Sparse),
];

#[test]
fn a_weld_turned_into_friction_rows_holds_up_to_its_limit_and_no_further() {
    for (solver, storage) in CASES {
        let mut sim = pair(solver, storage);
        let cube = sim.model().body("cube").unwrap();
        let dof = sim.model().body_dofadr()[cube.index()] as usize + 2;
        // Above the weight it holds like the weld: no acceleration, and the row's force is the weight.
        step_with_limit(&mut sim, 2.0 * WEIGHT);
        assert!(sim.qacc()[dof].abs() < 2e-2, "{solver:?} {storage:?}: {}", sim.qacc()[dof]);
        assert!((sim.efc_force()[2].abs() - WEIGHT).abs() < 1e-2 * WEIGHT, "{:?}", &sim.efc_force()[..6]);
        assert_eq!(sim.row_state(2).unwrap(), RowState::Quadratic);
        // Below it the force is the limit, and the cube falls with the rest.
        sim.reset().unwrap();
        step_with_limit(&mut sim, 0.25 * WEIGHT);
        assert!((sim.efc_force()[2].abs() - 0.25 * WEIGHT).abs() < 1e-9 * WEIGHT, "{:?}", &sim.efc_force()[..6]);
        assert!((sim.qacc()[dof] + 0.75 * 9.81).abs() < 1e-6, "{solver:?} {storage:?}: {}", sim.qacc()[dof]);
        assert!(matches!(sim.row_state(2).unwrap(), RowState::AtUpperLimit | RowState::AtLowerLimit));
    }
}

#[test]
fn rows_are_found_and_rewritten() {
    for storage in [JacobianStorage::Dense, JacobianStorage::Sparse] {
        let mut sim = pair(Solver::Newton, storage);
        sim.forward().unwrap();
        let weld = sim.model().equality("w").unwrap();
        assert_eq!(sim.equality_rows(weld), Some(0..6));
        assert_eq!((sim.ne(), sim.nf()), (6, 1));
        let kinds: Vec<_> = (0..sim.nefc()).map(|row| sim.constraint_row(row).unwrap().kind).collect();
        assert_eq!(kinds[..7], [[RowKind::Equality; 6].as_slice(), &[RowKind::FrictionDof]].concat());
        assert!(kinds[7..].iter().all(|kind| *kind == RowKind::ContactPyramidal) && kinds.len() > 7);

        // J qvel from the rows read one by one is the engine's product, also after a row was replaced.
        let nv = sim.model().nv();
        let v: Vec<f64> = (0..nv).map(|i| (i as f64 + 0.5).cos()).collect();
        let mut rows = vec![vec![0.0; nv]; sim.nefc()];
        for replaced in [false, true] {
            if replaced {
                let twice: Vec<f64> = rows[4].iter().map(|x| 2.0 * x).collect();
                assert!(twice.iter().any(|x| *x != 0.0));
                sim.set_row_jacobian(4, &twice).unwrap();
            }
            let mut product = vec![0.0; sim.nefc()];
            sim.mul_constraint_jacobian(&v, &mut product).unwrap();
            for (row, buffer) in rows.iter_mut().enumerate() {
                let old = buffer[nv - 1];
                sim.row_jacobian(row, buffer).unwrap();
                let expected: f64 = buffer.iter().zip(&v).map(|(j, v)| j * v).sum();
                assert!((product[row] - expected).abs() < 1e-12, "row {row}");
                assert!(!replaced || row != 4 || old == 0.0 || buffer[nv - 1] == 2.0 * old);
            }
            // The transpose is kept in step.
            let f: Vec<f64> = (0..sim.nefc()).map(|i| (i as f64).sin()).collect();
            let mut forces = vec![0.0; nv];
            sim.mul_constraint_jacobian_transposed(&f, &mut forces).unwrap();
            for (dof, force) in forces.iter().enumerate() {
                let expected: f64 = rows.iter().zip(&f).map(|(row, f)| row[dof] * f).sum();
                assert!((force - expected).abs() < 1e-12, "{storage:?} dof {dof}");
            }
        }

        sim.set_row_kbip(4, [10.0, 20.0, 0.5, 0.0]).unwrap();
        sim.set_row_position(4, 0.03).unwrap();
        sim.set_row_regularization(4, 0.25).unwrap();
        assert_eq!((sim.efc_R()[4], sim.efc_D()[4], sim.efc_diagonal()[4]), (0.25, 4.0, 0.25));
        sim.velocity().unwrap();
        // aref = -B v - K I (pos - margin), at rest.
        assert!((sim.efc_aref()[4] + 10.0 * 0.5 * 0.03).abs() < 1e-15);
        sim.set_row_reference(4, 7.0).unwrap();
        assert_eq!(sim.efc_aref()[4], 7.0);
        sim.actuation().unwrap();
        sim.acceleration().unwrap();
        sim.constraint().unwrap();
        // The new making of rows forgets all of this.
        sim.make_constraint().unwrap();
        assert_ne!(sim.efc_R()[4], 0.25);
    }
}

#[test]
fn an_equality_that_is_off_has_no_rows() {
    let mut sim = pair(Solver::Newton, JacobianStorage::Dense);
    let weld = sim.model().equality("w").unwrap();
    assert!(sim.is_equality_active(weld).unwrap());
    sim.set_equality_active(weld, false).unwrap();
    sim.forward().unwrap();
    assert_eq!((sim.equality_rows(weld), sim.ne()), (None, 0));
    sim.set_equality_active(weld, true).unwrap();
    sim.forward().unwrap();
    assert_eq!(sim.equality_rows(weld), Some(0..6));
}

#[test]
fn rows_that_do_not_exist_and_numbers_that_make_no_sense_are_errors() {
    let mut sim = pair(Solver::Newton, JacobianStorage::Sparse);
    assert!(matches!(sim.constraint_row(0), Err(Error::OutOfRange { .. })), "nothing is made yet");
    sim.forward().unwrap();
    let nv = sim.model().nv();
    assert!(matches!(sim.make_friction_rows(7), Err(Error::OutOfRange { .. })));
    assert!(matches!(sim.set_row_friction_limit(0, 1.0), Err(Error::Unsupported(_))), "an equality row");
    sim.set_row_friction_limit(6, 1.0).unwrap();
    assert!(matches!(sim.set_row_friction_limit(6, -1.0), Err(Error::Value { .. })));
    assert!(matches!(sim.set_row_regularization(0, 0.0), Err(Error::Value { .. })));
    assert!(matches!(sim.set_row_regularization(0, 1e-320), Err(Error::Value { .. })));
    assert!(matches!(sim.set_row_position(0, f64::NAN), Err(Error::Value { .. })));
    assert!(matches!(sim.set_row_jacobian(0, &vec![0.0; nv - 1]), Err(Error::Length { .. })));
    assert!(matches!(sim.set_row_jacobian(0, &vec![f64::INFINITY; nv]), Err(Error::Value { .. })));
    // The first ball's degrees of freedom are not among the weld's columns.
    assert!(matches!(sim.set_row_jacobian(0, &vec![1.0; nv]), Err(Error::Unsupported(_))));
    let beyond = sim.nefc();
    assert!(sim.set_row_reference(beyond, 0.0).is_err() && sim.row_state(beyond).is_err());
}

#[test]
fn changed_options_and_new_collisions_drop_the_old_rows() {
    let mut sim = pair(Solver::Newton, JacobianStorage::Dense);
    sim.forward().unwrap();
    assert!(sim.nefc() > 0 && sim.contact_count() == 1);
    sim.collision().unwrap();
    assert_eq!((sim.nefc(), sim.contact_count()), (0, 1));
    assert_eq!(sim.contact(0).unwrap().efc_address, None);
    assert_eq!(sim.contact_force(0).unwrap().force.norm(), 0.0);
    sim.forward().unwrap();
    sim.set_jacobian_storage(JacobianStorage::Sparse).unwrap();
    assert_eq!((sim.nefc(), sim.contact_count()), (0, 0));
    // A solve now has nothing to solve, and nothing of the old storage to read.
    sim.constraint().unwrap();
    assert_eq!(sim.qacc(), sim.qacc_smooth());
}

/// MuJoCo 3 also joins sites; their numbers are not those of their bodies.
#[test]
fn the_bodies_of_an_equality_are_those_of_its_sites_too() {
    let joined = |equality: &str| {
        let model = Model::from_xml_string(&format!(
            "<mujoco><worldbody><site name='s0'/><site name='s1'/>
             <body name='a'><freejoint/><geom size='.1'/><site name='s2'/></body>
             <body name='b' pos='1 0 0'><joint type='ball'/><geom size='.1'/><site name='s3'/><site name='s4'/></body>
             </worldbody><equality>{equality}</equality></mujoco>"
        ))
        .unwrap();
        let id = model.equalities().last().unwrap();
        model.equality_bodies(id).map(|bodies| bodies.map(|body| body.index()))
    };
    assert_eq!(joined("<weld body1='b' body2='a'/>"), Some([2, 1]));
    assert_eq!(joined("<connect body1='a' anchor='0 0 0'/>"), Some([1, 0]));
    #[cfg(mujoco3)]
    {
        assert_eq!(joined("<weld site1='s4' site2='s2'/>"), Some([2, 1]));
        assert_eq!(joined("<connect site1='s2' site2='s1'/>"), Some([1, 0]));
        assert_eq!(joined("<weld body1='a' body2='b'/><weld site1='s0' site2='s3'/>"), Some([0, 2]));
    }
}
