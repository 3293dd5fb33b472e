//! What safe code hands to the engine as an address or a count is checked: nothing reads or writes where it must not.

use mujoco_grasp::mujoco::*;
use nalgebra::{Vector3, Vector6};

const BALL: &str = r#"<mujoco><option cone="elliptic"/><worldbody><geom type="plane" size="9 9 1"/>
  <body name="b" pos="0 0 .099"><freejoint/><geom size=".1"/><site name="s"/></body></worldbody>
  <sensor><touch site="s"/></sensor></mujoco>"#;

fn simulation(xml: &str) -> Simulation {
    let mut sim = Simulation::new(&Model::from_xml_string(xml).unwrap()).unwrap();
    sim.forward().unwrap();
    sim
}

#[test]
fn an_appended_contact_with_a_geom_or_condim_that_does_not_exist_is_refused() {
    let mut sim = simulation(BALL);
    let good = sim.contact(0).unwrap();
    for beyond in [2, 100_000, usize::MAX] {
        let bad = Contact { geoms: [GeomId::from_index(beyond), good.geoms[0]], ..good.clone() };
        assert!(matches!(sim.append_contact(&bad), Err(Error::OutOfRange { kind: "geom", count: 2, .. })));
        let bad = Contact { geoms: [good.geoms[0], GeomId::from_index(beyond)], ..good.clone() };
        assert!(matches!(sim.append_contact(&bad), Err(Error::OutOfRange { kind: "geom", .. })));
    }
    for condim in [0, 2, 5, 7, 1000, usize::MAX] {
        let bad = Contact { condim, ..good.clone() };
        assert!(matches!(sim.append_contact(&bad), Err(Error::Value { .. })), "{condim}");
    }
    assert_eq!(sim.contact_count(), 1);
    // Its address is the engine's business: one that is given is not taken.
    let index = sim.append_contact(&Contact { efc_address: Some(1_000_000), ..good }).unwrap().unwrap();
    assert_eq!(sim.contact(index).unwrap().efc_address, None);
    assert_eq!(sim.contact_force(index).unwrap().force, Vector3::zeros());
    sim.rne_post_constraint().unwrap();
    sim.sensor_acc().unwrap();
}

#[test]
fn a_shown_force_is_written_behind_the_rows_or_not_at_all() {
    let mut sim = simulation(BALL);
    sim.collision().unwrap();
    let contact = sim.contact(0).unwrap();
    let index = sim.append_contact(&contact).unwrap().unwrap();
    sim.make_constraint().unwrap();
    sim.velocity().unwrap();
    sim.constraint().unwrap();
    let (rows, forces) = (sim.nefc(), sim.efc_force().to_vec());
    assert_eq!(rows, 3);
    // Sums that wrap around to a place in front of the array, or in it.
    for offset in (0..100).map(|back| usize::MAX - back).chain([1 << 40, 1 << 61, 1 << 62, 1 << 63, 100_000_000]) {
        assert!(!sim.show_contact_force(index, offset, &[7.0; 3]).unwrap(), "{offset}");
    }
    // The engine reads as many rows as the contact has.
    for count in [0, 1, 2, 4, 36] {
        let result = sim.show_contact_force(index, 0, &vec![7.0; count]);
        assert!(matches!(result, Err(Error::Length { expected: 3, .. })), "{count}: {result:?}");
    }
    assert!(matches!(sim.show_contact_force(0, 0, &[7.0; 3]), Err(Error::Unsupported(_))));
    assert!(matches!(sim.show_contact_force(9, 0, &[7.0; 3]), Err(Error::OutOfRange { .. })));
    assert_eq!(sim.efc_force(), forces);
    assert!(sim.show_contact_force(index, 0, &[7.0, 0.0, 0.0]).unwrap());
    assert_eq!(sim.efc_force(), forces);
    assert!((sim.contact_force(index).unwrap().force - 7.0 * contact.normal()).norm() < 1e-12);
}

/// A body with skins of so many pairs of vertices.
fn skins(sizes: &[usize]) -> String {
    let skin = |(i, &pairs): (usize, &usize)| {
        let list = |n: usize, text: &dyn Fn(usize) -> String| (0..n).map(text).collect::<String>();
        let vertices = list(pairs, &|i| format!("{i} 0 0 {i} 1 0 "));
        let faces = list(pairs - 1, &|i| format!("{} {} {} ", 2 * i, 2 * i + 1, 2 * i + 2));
        let (ids, weights) = (list(2 * pairs, &|i| format!("{i} ")), "1 ".repeat(2 * pairs));
        format!(
            "<skin name='s{i}' vertex='{vertices}' face='{faces}'><bone body='b' bindpos='0 0 0' \
             bindquat='1 0 0 0' vertid='{ids}' vertweight='{weights}'/></skin>"
        )
    };
    let skins: String = sizes.iter().enumerate().map(skin).collect();
    // Skins are assets in 2.2.2, and elements of their own in later versions, which still take them there.
    format!(
        "<mujoco><asset>{skins}</asset><worldbody><body name='b'><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
}

#[test]
fn a_renderer_draws_no_model_whose_skins_are_others() {
    let view = Camera::around(Vector3::zeros(), 5.0, 0.0, 0.0);
    // Also where all sizes of the model are the same, and only what each skin has of them differs.
    for (made_for, drawn) in [(vec![3], vec![2000]), (vec![3, 2000], vec![2000, 3])] {
        let (made_for, drawn) = (simulation(&skins(&made_for)), simulation(&skins(&drawn)));
        let mut renderer = Renderer::new(made_for.model(), 16, 16).expect("a renderer");
        let error = renderer.render(&drawn, view).unwrap_err();
        assert!(matches!(error, Error::OtherModel { .. }), "{error:?}");
        renderer.render(&made_for, view).unwrap();
        renderer.render(&made_for.clone(), view).unwrap();
    }
}

#[test]
fn faces_with_corners_that_are_no_vertices_are_refused() {
    for corner in [6, 99_999_999] {
        let xml = skins(&[3]).replace("face='0 1 2 ", &format!("face='0 1 {corner} "));
        let text = Model::from_xml_string(&xml).unwrap_err().to_string();
        assert!(text.contains(&corner.to_string()) && text.contains("no vertex"), "{text}");
    }
}

/// Of an id that is too large for the model, as those of another model may be.
#[test]
fn ids_and_indices_that_do_not_exist_give_errors_or_nothing_and_no_panic() {
    let mut sim = simulation(BALL);
    let nv = sim.model().nv();
    for i in [2, 999, 1 << 31, usize::MAX / 9, usize::MAX] {
        let (body, geom, site) = (BodyId::from_index(i), GeomId::from_index(i), SiteId::from_index(i));
        let none = |numbers: &[f64]| numbers.iter().all(|number| number.is_nan());
        assert!(none(sim.body_position(body).as_slice()) && none(sim.body_rotation(body).as_slice()));
        assert!(none(sim.body_quaternion(body).coords.as_slice()) && none(sim.body_com(body).as_slice()));
        assert!(none(sim.body_inertia_world(body).as_slice()) && none(sim.subtree_com_of(body).as_slice()));
        assert!(none(sim.geom_position(geom).as_slice()) && none(sim.geom_rotation(geom).as_slice()));
        assert!(none(sim.site_position(site).as_slice()) && none(sim.site_rotation(site).as_slice()));
        assert!(sim.body_twist(body).is_err() && sim.body_com_twist(body).is_err() && sim.body_wrench(body).is_err());
        assert_eq!(sim.mass_factor().ancestors(i.max(nv)).chain(sim.mass_rows().row(i.max(nv))).count(), 0);

        let mut six = vec![0.0; 6 * nv];
        assert!(sim.jac_point(body, &Vector3::zeros(), &mut six).is_err() && sim.jac_body(body, &mut six).is_err());
        assert!(sim.jac_body_com(body, &mut six).is_err() && sim.jac_site(site, &mut six).is_err());
        assert!(sim.jac_geom(geom, &mut six).is_err());
        let mut one = vec![0.0; nv];
        let zero = Vector3::zeros();
        assert!(sim.add_generalized_force(body, &zero, &zero, &zero, &mut one).is_err());
        assert!(sim.apply_force_at(body, &zero, &zero, &zero).is_err());
        assert!(sim.set_body_wrench(body, &zero, &zero).is_err());
        assert!(sim.actuator_moment_into(ActuatorId::from_index(i), &mut one).is_err());
        assert!(sim.is_equality_active(EqualityId::from_index(i)).is_err());
        assert!(sim.set_equality_active(EqualityId::from_index(i), true).is_err());
        assert!(sim.reset_to_keyframe(KeyframeId::from_index(i)).is_err());
        assert!(sim.contact(i).is_err() && sim.contact_force(i).is_err() && sim.exclude_contact(i).is_err());
        assert_eq!(sim.contact_bodies(i), None);

        let row = i.max(sim.nefc());
        assert!(sim.constraint_row(row).is_err() && sim.row_state(row).is_err());
        assert!(sim.row_jacobian(row, &mut one).is_err() && sim.set_row_jacobian(row, &one).is_err());
        assert!(sim.set_row_friction_limit(row, 1.0).is_err() && sim.set_row_position(row, 1.0).is_err());
        assert!(sim.set_row_kbip(row, [1.0; 4]).is_err() && sim.set_row_regularization(row, 1.0).is_err());
        assert!(sim.set_row_reference(row, 1.0).is_err() && sim.make_friction_rows(row).is_err());
        assert_eq!(sim.equality_rows(EqualityId::from_index(i)), None);

        let model = sim.model();
        assert_eq!((model.body_name(body), model.free_joint_of(body)), (None, None));
        assert_eq!((model.joint_kind(JointId::from_index(i)), model.geom_kind(geom)), (None, None));
        assert_eq!(model.equality_kind(EqualityId::from_index(i)), None);
        assert_eq!(model.equality_bodies(EqualityId::from_index(i)), None);
        assert!(model.subtree(body).is_err() && !model.label(geom).is_empty());
        assert!(Camera::on_grasp(&sim, body, BodyId::WORLD).is_err());
        assert!(Camera::on_grasp(&sim, BodyId::WORLD, body).is_err());
        if PairCollider::supported() {
            assert!(PairCollider::new(&sim, &[geom], &[geom]).is_err());
        }
    }
    assert_eq!(sim.body_wrench(BodyId::from_index(1)).unwrap(), Vector6::zeros());
}

#[test]
fn a_state_of_another_model_is_refused_whole() {
    let mut sim = simulation(BALL);
    let mut state = simulation("<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>").save();
    assert!(matches!(sim.restore(&state), Err(Error::Length { .. })));
    state = sim.save();
    state.eq_active.push(1);
    assert!(matches!(sim.restore(&state), Err(Error::Length { .. })));
    sim.step().unwrap();
}
