//! MuJoCo 3 keeps contacts, rows and its stack in one arena: whatever does not fit in it is an error. What the crate does
//! not do with it is one, too.

use mujoco_grasp::mujoco::{Buffer, Error, Model, Simulation};

/// One body of many balls on a plane: contacts take more memory than anything else.
fn brush(memory: usize) -> Result<Simulation, Error> {
    let balls: String = (0..80).map(|i| format!("<geom size='0.1' pos='{i} 0 0.099'/>")).collect();
    Simulation::new(&Model::from_xml_string(&format!(
        "<mujoco><size memory='{memory}'/><worldbody><geom type='plane' size='99 9 1'/><body><freejoint/>{balls}</body>
         </worldbody></mujoco>"
    ))?)
}

/// Boxes that lie on a plane, with this much memory (bytes).
fn boxes(memory: usize) -> Result<Simulation, Error> {
    let bodies: String = (0..6)
        .map(|i| format!("<body pos='{i} 0 0.099'><freejoint/><geom type='box' size='0.1 0.1 0.1'/></body>"))
        .collect();
    Simulation::new(&Model::from_xml_string(&format!(
        "<mujoco><size memory='{memory}'/><worldbody><geom type='plane' size='9 9 1'/>{bodies}</worldbody></mujoco>"
    ))?)
}

/// From far too little memory to enough, in small steps: every outcome is an error that names what to raise, and after
/// it the simulation can be reset and faults at the same place again.
#[test]
fn every_shortage_of_memory_is_an_error_that_names_the_attribute() {
    let (mut contacts, mut rows, mut stack, mut fine) = (0, 0, 0, 0);
    let memories = || (2_000..400_000).step_by(500);
    for (memory, made) in memories().map(|m| (m, boxes(m))).chain(memories().map(|m| (m, brush(m)))) {
        let first = match made {
            Ok(mut sim) => {
                let first = sim.step();
                if let Err(Error::Engine { .. }) = first {
                    assert!(matches!(sim.step(), Err(Error::Interrupted { .. })));
                    assert_eq!((sim.contact_count(), sim.nefc()), (0, 0));
                }
                sim.reset().unwrap();
                let again = sim.step();
                assert_eq!(format!("{first:?}"), format!("{again:?}"), "{memory}");
                first
            }
            Err(error) => Err(error),
        };
        match first {
            Ok(()) => fine += 1,
            Err(error) => {
                assert!(error.to_string().contains("memory"), "{memory}: {error}");
                match error {
                    Error::BufferFull { buffer: Buffer::Contacts, .. } => contacts += 1,
                    Error::BufferFull { buffer: Buffer::Constraints, .. } => rows += 1,
                    _ => stack += 1,
                }
            }
        }
    }
    println!("contacts {contacts}, rows {rows}, stack {stack}, fine {fine}");
    assert!(contacts > 0 && rows > 0 && stack > 0 && fine > 0, "{contacts} {rows} {stack} {fine}");
}

#[test]
fn what_the_crate_does_not_handle_is_refused_by_name() {
    let flex = "<mujoco><worldbody><flexcomp name='f' type='grid' count='3 3 1' spacing='.1 .1 .1' dim='2'/></worldbody></mujoco>";
    let text = Model::from_xml_string(flex).unwrap_err().to_string();
    assert!(text.contains("flexible bodies"), "{text}");
}

/// Contacts and rows give their memory back however often they are made within a step.
#[test]
fn making_rows_again_and_again_takes_no_more_memory() {
    let mut sim = boxes(2_000_000).unwrap();
    sim.step().unwrap();
    for _ in 0..2000 {
        sim.make_constraint().unwrap();
    }
    for _ in 0..2000 {
        sim.skip_collision();
        sim.make_constraint().unwrap();
    }
    sim.step().unwrap();
}

/// Forces of contacts that another solver has solved find room behind the rows.
#[test]
fn shown_forces_fit_behind_the_rows() {
    let mut sim = boxes(2_000_000).unwrap();
    sim.step().unwrap();
    sim.kinematics().unwrap();
    sim.inertia().unwrap();
    sim.collision().unwrap();
    let (excluded, kept) = (0, 5);
    sim.exclude_contact(excluded).unwrap();
    sim.make_constraint().unwrap();
    sim.transmission().unwrap();
    sim.project_constraint().unwrap();
    sim.velocity().unwrap();
    sim.actuation().unwrap();
    sim.acceleration().unwrap();
    sim.constraint().unwrap();
    let (rows, of_kept) = (sim.efc_force().to_vec(), sim.contact_force(kept).unwrap());
    assert!(of_kept.force.norm() > 0.0);
    assert_eq!(sim.contact_force(excluded).unwrap().force.norm(), 0.0);
    assert!(sim.show_contact_force(excluded, 0, &[1.0, 2.0, 3.0, 4.0]).unwrap());
    // Four edges of a pyramid: the normal force is their sum.
    let normal = sim.contact(excluded).unwrap().normal();
    let check = |sim: &Simulation| {
        let shown = sim.contact_force(excluded).unwrap().force;
        assert!(
            (shown.dot(&normal) - 10.0).abs() < 1e-12,
            "{shown} of {:?}, {} rows",
            sim.contact(excluded),
            sim.nefc()
        );
        assert_eq!(sim.contact_force(kept).unwrap(), of_kept);
        assert_eq!(sim.efc_force(), rows);
    };
    check(&sim);
    check(&sim.clone());
    assert!(!sim.show_contact_force(excluded, 100_000, &[1.0; 4]).unwrap());
    sim.step().unwrap();
    assert!(matches!(sim.show_contact_force(0, 0, &[1.0; 4]), Err(Error::Unsupported(_))));
}
