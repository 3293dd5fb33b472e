//! Largest wrench that a merged grasp holds, axis by axis: thesis Eqs. 4.1 to 4.3.

use crate::grasp::monitor::wrench::LoadedContact;
use nalgebra::Vector3;

/// One bound for the linear axes and one for the angular ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Bounds {
    /// `mu F_perp` \[N\], Eq. 4.1.
    pub force: f64,
    /// `mu |r| F_perp` \[N m\], Eq. 4.2.
    pub torque: f64,
}

impl Bounds {
    /// The bounds that the contacts' normal forces give.
    ///
    /// `F_perp = sum f_i . n_i` (Eq. 4.3). The thesis has one `mu` for all contacts; here each normal force counts with
    /// its own contact's sliding coefficient, which is the same where they agree. A contact that pulls (only a bilateral
    /// row can) counts as none. `r` is the mean distance of the contacts that push from their centroid.
    pub fn of(contacts: impl Iterator<Item = LoadedContact> + Clone) -> Bounds {
        let pushing = contacts.filter(|c| c.normal_force > 0.0);
        let count = pushing.clone().count();
        if count == 0 {
            return Bounds::default();
        }
        let mean = 1.0 / count as f64;
        let centroid: Vector3<f64> = pushing.clone().map(|c| c.position * mean).sum();
        let radius: f64 = pushing.clone().map(|c| (c.position - centroid).norm() * mean).sum();
        let force: f64 = pushing.map(|c| c.active_friction().first().copied().unwrap_or(0.0) * c.normal_force).sum();
        Bounds { force, torque: radius * force }
    }

    /// Bound of axis `axis`: 0 to 2 linear, 3 to 5 angular.
    pub fn axis(&self, axis: usize) -> f64 {
        if axis < 3 { self.force } else { self.torque }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contact(position: [f64; 3], mu: f64, normal_force: f64) -> LoadedContact {
        let position = Vector3::from(position);
        let normal = -position.normalize();
        let t = normal.cross(&Vector3::new(0.3, 0.5, 0.9)).normalize();
        LoadedContact {
            position,
            normal,
            tangents: [t, normal.cross(&t)],
            condim: 3,
            friction: [mu, mu, 0.005, 1e-4, 1e-4],
            normal_force,
            force: normal * normal_force,
            torque: Vector3::zeros(),
        }
    }

    #[test]
    fn a_pinch_has_the_closed_form_of_the_thesis() {
        // mu F_perp = 0.8 (2 + 2); r = 0.03
        let pair = [contact([0.03, 0.0, 0.0], 0.8, 2.0), contact([-0.03, 0.0, 0.0], 0.8, 2.0)];
        let bounds = Bounds::of(pair.iter().copied());
        assert!((bounds.force - 3.2).abs() < 1e-12);
        assert!((bounds.torque - 0.096).abs() < 1e-12);
        assert_eq!([bounds.axis(2), bounds.axis(3)], [bounds.force, bounds.torque]);
    }

    #[test]
    fn mixed_friction_weighs_each_normal_force_by_its_own() {
        let three = [
            contact([0.03, 0.0, 0.0], 1.0, 2.0),
            contact([0.0, 0.03, 0.0], 0.5, 3.0),
            contact([0.0, 0.0, 0.03], 0.2, 1.0),
        ];
        let bounds = Bounds::of(three.iter().copied());
        assert!((bounds.force - 3.7).abs() < 1e-12);
        // the centroid of three unit points is at a distance of sqrt(2/3) from each
        assert!((bounds.torque - 3.7 * 0.03 * (2.0f64 / 3.0).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn bounds_do_not_depend_on_frame_or_order_and_scale_with_the_grip() {
        let points = [[0.03, 0.0, 0.01], [-0.01, 0.02, 0.0], [0.0, -0.03, 0.02]];
        let hand: Vec<_> = points.iter().map(|p| contact(*p, 0.7, 1.5)).collect();
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -1.0, 2.0);
        let shift = Vector3::new(1.0, -2.0, 0.5);
        let moved: Vec<_> = hand
            .iter()
            .rev()
            .map(|c| LoadedContact {
                position: turn * c.position + shift,
                normal: turn * c.normal,
                tangents: c.tangents.map(|t| turn * t),
                force: turn * c.force,
                ..*c
            })
            .collect();
        let harder: Vec<_> = hand.iter().map(|c| contact(c.position.into(), 0.7, 3.0)).collect();
        let [a, b, c] = [&hand, &moved, &harder].map(|h| Bounds::of(h.iter().copied()));
        assert!((a.force - b.force).abs() < 1e-12 && (a.torque - b.torque).abs() < 1e-12);
        assert!((2.0 * a.force - c.force).abs() < 1e-12 && (2.0 * a.torque - c.torque).abs() < 1e-12);
    }

    #[test]
    fn a_contact_that_pulls_or_has_no_friction_holds_nothing() {
        let mut slippery = contact([0.03, 0.0, 0.0], 0.8, 2.0);
        slippery.condim = 1;
        assert_eq!(Bounds::of([slippery].into_iter()).force, 0.0);
        let pulling = contact([0.03, 0.0, 0.0], 0.8, -2.0);
        assert_eq!(Bounds::of([pulling].into_iter()), Bounds::default());
    }
}
