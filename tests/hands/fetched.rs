//! The Shadow Hand of gymnasium-robotics, unedited: several contacts on a link, palm contacts, pyramidal cones.

use crate::wheel;
use mujoco_grasp::mujoco::{Cone, Model, Simulation};

#[test]
fn scenes_load_unedited_and_step() {
    let Some(assets) = wheel::assets() else { return };
    for scene in ["manipulate_block", "manipulate_egg"] {
        let model = Model::from_xml_file(assets.join("hand").join(format!("{scene}.xml"))).unwrap();
        let mut sim = Simulation::new(&model).unwrap();
        assert_eq!((sim.model().nv(), sim.model().nu(), sim.model().cone()), (36, 20, Cone::Pyramidal), "{scene}");
        let object = sim.model().body("object").unwrap();
        let mut most = 0;
        // held by nothing, it drops onto the palm, lies there on several contacts, and rolls off the open hand
        while sim.time() < 1.0 {
            sim.step().unwrap();
            let touching = sim.contacts().filter(|c| c.other_body(object).is_some()).count();
            most = most.max(touching);
        }
        assert!(sim.qpos().iter().chain(sim.qvel()).all(|x| x.is_finite()), "{scene}");
        assert!(most >= 2, "{scene}: {most} contacts of the object at most");
        assert_eq!(sim.take_warnings(), [], "{scene}");
    }
}
