use super::*;
use crate::mujoco::{Model, compat};
use std::time::{Duration, Instant};

const XML: &str = r#"<mujoco><option noslip_iterations="3"/><worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body pos="0 0 .09"><freejoint/><geom size=".1" mass="1"/></body>
    <body pos="1 0 .3"><joint name="hinge" axis="0 1 0"/><geom type="capsule" size=".02 .1" mass="1"/></body>
    </worldbody><actuator><motor joint="hinge"/></actuator></mujoco>"#;

/// The owner of a model and its data.
fn owner() -> Simulation {
    Simulation::new(&Model::from_xml_string(XML).unwrap()).unwrap()
}

/// Borrows from the owner, who must outlive what is returned.
fn borrow(owner: &Simulation) -> Borrowed {
    let (model, data) = owner.pointers();
    // SAFETY: they belong together, and the test keeps the owner and leaves it alone during visits.
    unsafe { Borrowed::new(NonNull::new(model).unwrap().cast(), NonNull::new(data).unwrap().cast()) }.unwrap()
}

#[test]
fn a_visit_steps_the_owners_data_bit_for_bit() {
    let (owner, mut alone) = (owner(), owner());
    let mut borrowed = borrow(&owner);
    for _ in 0..200 {
        borrowed.visit(false, Simulation::step).unwrap().unwrap();
        alone.step().unwrap();
    }
    assert_eq!((owner.qpos(), owner.time()), (alone.qpos(), alone.time()));
    drop(borrowed);
    assert_eq!(owner.qpos(), alone.qpos());
}

#[test]
fn changes_of_the_owner_are_noticed_and_nothing_else_is() {
    let mut owner = owner();
    let mut borrowed = borrow(&owner);
    let mut noticed = |owner: &mut Simulation, change: &dyn Fn(&mut Simulation)| {
        let before = borrowed.sim().stamp();
        change(owner);
        let seen = borrowed.visit(true, |sim| (sim.stamp() != before, sim.model().origin())).unwrap();
        borrowed.visit(true, Simulation::step).unwrap().unwrap();
        seen
    };
    let (first, origin) = noticed(&mut owner, &|_| ());
    assert!(first, "nothing is known before the first visit");
    // what every step reads anew
    let inputs: [&dyn Fn(&mut Simulation); 4] =
        [&|_| (), &|s| s.ctrl_mut()[0] = 0.1, &|s| s.xfrc_applied_mut()[6] = 0.1, &|s| s.dof_damping_mut()[6] = 0.5];
    for change in inputs {
        assert_eq!(noticed(&mut owner, change), (false, origin));
    }
    let changes: [&dyn Fn(&mut Simulation); 5] = [
        &|s| s.qpos_mut()[0] += 1e-12,
        &|s| s.forward().unwrap(),
        &|s| s.kinematics().unwrap(),
        &|s| s.reset().unwrap(),
        &|s| s.dof_armature_mut()[6] = 0.5,
    ];
    for (i, change) in changes.into_iter().enumerate() {
        assert_eq!(noticed(&mut owner, change), (true, origin), "change {i}");
    }
    let (changed, other) = noticed(&mut owner, &|s| {
        let (model, _) = s.pointers();
        // SAFETY: the owner's model, which has two geoms more.
        unsafe { *(*model).geom_size.add(3) = 0.11 };
    });
    assert!(changed && other != origin, "shapes are derived from the model");
}

#[test]
fn options_and_counters_are_the_owners_after_a_visit() {
    let mut owner = owner();
    let mut borrowed = borrow(&owner);
    let counters = |owner: &Simulation| owner.data().warning.map(|counter| counter.number);
    // an old count of the owner's is no warning of ours
    owner.data_mut().warning[0].number = 7;
    let noslip = borrowed.visit(false, |sim| {
        sim.set_noslip_iterations(0)?;
        sim.set_contacts_enabled(false);
        sim.step().map(|()| sim.model().noslip_iterations())
    });
    assert_eq!(noslip.unwrap().unwrap(), 0);
    assert_eq!(owner.model().noslip_iterations(), 3);
    assert!(owner.model().has_contacts());
    assert_eq!(counters(&owner)[0], 7);
    owner.ctrl_mut()[0] = f64::NAN;
    let result = borrowed.visit(false, Simulation::step).unwrap();
    assert!(matches!(result, Err(Error::BadControl { .. })), "{result:?}");
    assert_eq!(counters(&owner)[0], 7);
    assert_eq!(counters(&owner)[ffi::mjWARN_BADCTRL as usize], 1);
    assert_eq!(borrowed.take_warnings().len(), 1);
    // what the engine resets has its counts reset, too
    owner.ctrl_mut()[0] = 0.0;
    owner.qpos_mut()[0] = f64::NAN;
    let result = borrowed.visit(false, Simulation::step).unwrap();
    assert!(matches!(result, Err(Error::Diverged { .. })), "{result:?}");
    assert_eq!(counters(&owner)[0], 0);
    assert_eq!(counters(&owner)[ffi::mjWARN_BADQPOS as usize], 1);
}

#[test]
fn a_fault_is_an_error_and_the_next_visit_goes_on() {
    let owner = owner();
    let mut borrowed = borrow(&owner);
    let fault = |sim: &mut Simulation| sim.run("mju_error", |_, _| compat::raise_fault(c"a wheel fell off"));
    assert!(matches!(borrowed.visit(false, fault).unwrap(), Err(Error::Engine { .. })));
    borrowed.visit(false, Simulation::step).unwrap().unwrap();
    assert!(owner.time() > 0.0);
}

#[test]
fn a_copy_of_a_borrowed_simulation_owns_its_memory() {
    let owner = owner();
    let mut copy = borrow(&owner).sim().clone();
    copy.step().unwrap();
    assert_eq!(owner.time(), 0.0);
    drop(owner);
    copy.step().unwrap();
}

/// A step is tens of microseconds.
#[test]
fn a_visit_costs_less_than_a_microsecond() {
    let owner = owner();
    let mut borrowed = borrow(&owner);
    let mut least = Duration::MAX;
    for _ in 0..1000 {
        let start = Instant::now();
        borrowed.visit(false, |_| ()).unwrap();
        least = least.min(start.elapsed());
    }
    println!("a visit without work takes {least:?}");
    assert!(least < Duration::from_micros(1), "{least:?}");
}
