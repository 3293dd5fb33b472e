//! The report: the contract's JSON, and bad input.

use crate::support::{contact, equator, on_sphere};
use mujoco_grasp::grasp::metrics::quality::{QualityError, report};
use mujoco_grasp::grasp::monitor::wrench::{ContactError, LoadedContact};
use nalgebra::{Vector3, Vector6};

const SOFT: [f64; 5] = [0.8, 0.8, 0.005, 0.0001, 0.0001];

fn weight(newtons: f64) -> Vector6<f64> {
    Vector6::new(0.0, 0.0, -newtons, 0.0, 0.0, 0.0)
}

#[test]
fn the_json_has_the_contracts_fields() {
    let grasp = on_sphere(&equator(5), 0.04, 3, SOFT, 1.0);
    let report = report(&grasp, &Vector3::zeros(), &weight(1.962)).expect("a valid grasp");
    let json = serde_json::to_value(report).expect("a report is JSON");
    let names: Vec<_> = json.as_object().expect("an object").keys().cloned().collect();
    for name in [
        "min_singular_value_n",
        "ferrari_canny_n",
        "hull_volume",
        "isotropy",
        "force_closure",
        "holds_own_weight",
        "contacts",
    ] {
        assert!(names.iter().any(|n| n == name), "{name} is missing");
    }
    assert_eq!(names.len(), 7);
    assert_eq!(json["contacts"], 5);
    assert_eq!(json["force_closure"], true);
    assert_eq!(json["holds_own_weight"], true);
    assert!(json["ferrari_canny_n"].as_f64().expect("a number") > 0.0);
}

#[test]
fn a_weight_is_held_up_to_the_live_friction() {
    let grasp = on_sphere(&equator(5), 0.04, 3, SOFT, 1.0);
    let holds = |newtons| report(&grasp, &Vector3::zeros(), &weight(newtons)).expect("a valid grasp").holds_own_weight;
    let most = 5.0 * SOFT[0];
    assert!(holds(0.98 * most));
    assert!(!holds(1.02 * most));
}

#[test]
fn no_contact_is_a_report_of_nothing() {
    let unloaded = on_sphere(&equator(5), 0.04, 3, SOFT, 0.0);
    for contacts in [&[][..], &unloaded] {
        let report = report(contacts, &Vector3::zeros(), &weight(1.0)).expect("no grasp, no fault");
        assert_eq!(report.contacts, 0);
        assert!(!report.force_closure && !report.holds_own_weight);
        assert_eq!(report.min_singular_value_n, 0.0);
        assert_eq!(report.ferrari_canny_n, 0.0);
        assert_eq!(report.hull_volume, 0.0);
        assert_eq!(report.isotropy, 0.0);
    }
}

#[test]
fn many_contacts_on_flat_faces_as_boxes_give_them() {
    // A box between two pads, four cohedral contacts each, and a thumb: symmetric, cohedral, and repeated points.
    let mut contacts = Vec::new();
    for side in [-1.0, 1.0] {
        for (y, z) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, 1.0)] {
            let at = Vector3::new(0.02 * side, 0.01 * y, 0.01 * z);
            contacts.push(contact(at, Vector3::new(-side, 0.0, 0.0), 4, SOFT, 0.5));
        }
    }
    contacts.push(contact(Vector3::new(0.0, 0.03, 0.0), -Vector3::y(), 6, SOFT, 0.1));
    let report = report(&contacts, &Vector3::zeros(), &weight(1.0)).expect("a valid grasp");
    assert!(report.force_closure && report.holds_own_weight);
    assert!(report.ferrari_canny_n > 0.0 && report.hull_volume > 0.0);
    assert!(report.min_singular_value_n > report.ferrari_canny_n);
}

#[test]
fn faults_name_the_contact_and_what_would_be_right() {
    let sound = contact(Vector3::x(), -Vector3::x(), 4, SOFT, 1.0);
    let nan = f64::NAN;
    let cases: [(LoadedContact, &str); 7] = [
        (LoadedContact { normal_force: -1.0, ..sound }, "it must be 0 or more"),
        (LoadedContact { normal_force: nan, ..sound }, "its normal force is not finite"),
        (LoadedContact { condim: 2, ..sound }, "condim is 2; it must be 1, 3, 4 or 6"),
        (LoadedContact { normal: Vector3::x() * 1.1, ..sound }, "not orthonormal"),
        (LoadedContact { friction: [0.5, -0.5, 0.0, 0.0, 0.0], ..sound }, "coefficient 1 is -0.5"),
        (LoadedContact { friction: [0.5, 0.5, nan, 0.0, 0.0], ..sound }, "its friction is not finite"),
        (LoadedContact { position: Vector3::repeat(nan), ..sound }, "its position is not finite"),
    ];
    for (bad, expected) in cases {
        let fault = report(&[sound, bad], &Vector3::zeros(), &weight(1.0)).expect_err(expected);
        let text = fault.to_string();
        assert!(text.contains(expected) && text.contains("contact 1"), "{text}");
        assert!(matches!(fault, QualityError::Contact(_)));
    }
    // Coefficients beyond the condim are not looked at.
    let hard = LoadedContact { condim: 3, friction: [0.5, 0.5, nan, nan, nan], ..sound };
    assert!(report(&[hard], &Vector3::zeros(), &weight(1.0)).is_ok());
    assert!(matches!(hard.check(0), Ok::<(), ContactError>(())));
    let com = Vector3::new(0.0, nan, 0.0);
    let fault = report(&[sound], &com, &weight(1.0)).expect_err("a NaN");
    assert!(fault.to_string().contains("centre of mass"));
    let fault = report(&[sound], &Vector3::zeros(), &weight(nan)).expect_err("a NaN");
    assert!(fault.to_string().contains("external wrench"));
}
