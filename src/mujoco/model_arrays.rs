//! Read access to the numeric arrays of a compiled model, under the engine's names.
//!
//! Matrices are row-major; quaternions are w, x, y, z. Angles are radians. Addresses of -1 mean "none".
#![allow(non_snake_case)] // The engine's names are the field's.

use super::arrays::{factor, read_arrays, slice};
use super::compiled::CompiledModel;
use super::{compat, ffi};

impl CompiledModel {
    #[inline]
    fn fields(&self) -> &ffi::mjModel {
        // SAFETY: the pointer is valid for as long as `self`.
        unsafe { &*self.as_ptr() }
    }

    read_arrays! { fields, fields;
        // default generalized coordinates
        qpos0: f64 [nq], "Qpos values at default pose";
        qpos_spring: f64 [nq], "Reference pose for springs";
        // bodies
        body_parentid: i32 [nbody], "Id of body's parent";
        body_rootid: i32 [nbody], "Id of root above body";
        body_weldid: i32 [nbody], "Id of body that this body is welded to";
        body_mocapid: i32 [nbody], "Id of mocap data; -1: none";
        body_jntnum: i32 [nbody], "Number of joints for this body";
        body_jntadr: i32 [nbody], "Start addr of joints; -1: no joints";
        body_dofnum: i32 [nbody], "Number of motion degrees of freedom";
        body_dofadr: i32 [nbody], "Start addr of dofs; -1: no dofs";
        body_geomnum: i32 [nbody], "Number of geoms";
        body_geomadr: i32 [nbody], "Start addr of geoms; -1: no geoms";
        body_simple: u8 [nbody], "Body is simple (has diagonal M)";
        body_sameframe: u8 [nbody], "Inertial frame is same as body frame";
        body_pos: f64 [nbody x 3], "Position offset rel. to parent body";
        body_quat: f64 [nbody x 4], "Orientation offset rel. to parent body";
        body_ipos: f64 [nbody x 3], "Local position of center of mass";
        body_iquat: f64 [nbody x 4], "Local orientation of inertia ellipsoid";
        body_mass: f64 [nbody], "Mass";
        body_subtreemass: f64 [nbody], "Mass of subtree starting at this body";
        body_inertia: f64 [nbody x 3], "Diagonal inertia in ipos/iquat frame";
        body_invweight0: f64 [nbody x 2], "Mean inv inert in qpos0 (trn, rot)";
        // joints
        jnt_type: i32 [njnt], "Type of joint (mjtJoint)";
        jnt_qposadr: i32 [njnt], "Start addr in 'qpos' for joint's data";
        jnt_dofadr: i32 [njnt], "Start addr in 'qvel' for joint's data";
        jnt_bodyid: i32 [njnt], "Id of joint's body";
        jnt_group: i32 [njnt], "Group for visibility";
        jnt_limited: u8 [njnt], "Does joint have limits";
        jnt_solref: f64 [njnt x 2], "Constraint solver reference: limit";
        jnt_solimp: f64 [njnt x 5], "Constraint solver impedance: limit";
        jnt_pos: f64 [njnt x 3], "Local anchor position";
        jnt_axis: f64 [njnt x 3], "Local joint axis";
        jnt_stiffness: f64 [njnt], "Stiffness coefficient";
        jnt_range: f64 [njnt x 2], "Joint limits";
        jnt_margin: f64 [njnt], "Min distance for limit detection";
        // dofs
        dof_bodyid: i32 [nv], "Id of dof's body";
        dof_jntid: i32 [nv], "Id of dof's joint";
        dof_parentid: i32 [nv], "Id of dof's parent; -1: none";
        dof_Madr: i32 [nv], "Dof address in M-diagonal";
        dof_simplenum: i32 [nv], "Number of consecutive simple dofs";
        dof_solref: f64 [nv x 2], "Constraint solver reference:frictionloss";
        dof_solimp: f64 [nv x 5], "Constraint solver impedance:frictionloss";
        dof_frictionloss: f64 [nv], "Dof friction loss";
        dof_armature: f64 [nv], "Dof armature inertia/mass";
        dof_damping: f64 [nv], "Damping coefficient";
        dof_invweight0: f64 [nv], "Diag. inverse inertia in qpos0";
        dof_M0: f64 [nv], "Diag. inertia in qpos0";
        // geoms
        geom_type: i32 [ngeom], "Geometric type (mjtGeom)";
        geom_contype: i32 [ngeom], "Geom contact type";
        geom_conaffinity: i32 [ngeom], "Geom contact affinity";
        geom_condim: i32 [ngeom], "Contact dimensionality (1, 3, 4, 6)";
        geom_bodyid: i32 [ngeom], "Id of geom's body";
        geom_dataid: i32 [ngeom], "Id of geom's mesh/hfield (-1: none)";
        geom_matid: i32 [ngeom], "Material id for rendering (-1: none)";
        geom_group: i32 [ngeom], "Group for visibility";
        geom_priority: i32 [ngeom], "Geom contact priority";
        geom_sameframe: u8 [ngeom], "Same as body frame (1) or iframe (2)";
        geom_solmix: f64 [ngeom], "Mixing coef for solref/imp in geom pair";
        geom_solref: f64 [ngeom x 2], "Constraint solver reference: contact";
        geom_solimp: f64 [ngeom x 5], "Constraint solver impedance: contact";
        geom_size: f64 [ngeom x 3], "Geom-specific size parameters";
        geom_rbound: f64 [ngeom], "Radius of bounding sphere";
        geom_pos: f64 [ngeom x 3], "Local position offset rel. to body";
        geom_quat: f64 [ngeom x 4], "Local orientation offset rel. to body";
        geom_friction: f64 [ngeom x 3], "Friction for (slide, spin, roll)";
        geom_margin: f64 [ngeom], "Detect contact if dist<margin";
        geom_gap: f64 [ngeom], "Include in solver if dist<margin-gap";
        geom_fluid: f64 [ngeom x 12], "Fluid interaction parameters";
        geom_rgba: f32 [ngeom x 4], "Rgba when material is omitted";
        // sites
        site_type: i32 [nsite], "Geom type for rendering (mjtGeom)";
        site_bodyid: i32 [nsite], "Id of site's body";
        site_group: i32 [nsite], "Group for visibility";
        site_sameframe: u8 [nsite], "Same as body frame (1) or iframe (2)";
        site_size: f64 [nsite x 3], "Geom size for rendering";
        site_pos: f64 [nsite x 3], "Local position offset rel. to body";
        site_quat: f64 [nsite x 4], "Local orientation offset rel. to body";
        site_rgba: f32 [nsite x 4], "Rgba when material is omitted";
        // cameras
        cam_mode: i32 [ncam], "Camera tracking mode (mjtCamLight)";
        cam_bodyid: i32 [ncam], "Id of camera's body";
        cam_targetbodyid: i32 [ncam], "Id of targeted body; -1: none";
        cam_pos: f64 [ncam x 3], "Position rel. to body frame";
        cam_quat: f64 [ncam x 4], "Orientation rel. to body frame";
        cam_poscom0: f64 [ncam x 3], "Global position rel. to sub-com in qpos0";
        cam_pos0: f64 [ncam x 3], "Global position rel. to body in qpos0";
        cam_mat0: f64 [ncam x 9], "Global orientation in qpos0";
        cam_fovy: f64 [ncam], "Y-field of view (deg)";
        cam_ipd: f64 [ncam], "Inter-pupilary distance";
        // meshes
        mesh_vertadr: i32 [nmesh], "First vertex address";
        mesh_vertnum: i32 [nmesh], "Number of vertices";
        mesh_faceadr: i32 [nmesh], "First face address";
        mesh_facenum: i32 [nmesh], "Number of faces";
        mesh_vert: f32 [nmeshvert x 3], "Vertex positions for all meshes";
        mesh_face: i32 [nmeshface x 3], "Triangle face data";
        // height fields
        hfield_size: f64 [nhfield x 4], "(x, y, z_top, z_bottom)";
        hfield_adr: i32 [nhfield], "Start address in hfield_data";
        hfield_nrow: i32 [nhfield], "Number of rows in grid";
        hfield_ncol: i32 [nhfield], "Number of columns in grid";
        hfield_data: f32 [nhfielddata], "Elevation data";
        // materials
        mat_rgba: f32 [nmat x 4], "Rgba";
        // predefined geom pairs for collision detection; has precedence over exclude
        pair_dim: i32 [npair], "Contact dimensionality";
        pair_geom1: i32 [npair], "Id of geom1";
        pair_geom2: i32 [npair], "Id of geom2";
        pair_signature: i32 [npair], "(body1+1)<<16 + body2+1";
        pair_solref: f64 [npair x 2], "Constraint solver reference: contact";
        pair_solimp: f64 [npair x 5], "Constraint solver impedance: contact";
        pair_margin: f64 [npair], "Detect contact if dist<margin";
        pair_gap: f64 [npair], "Include in solver if dist<margin-gap";
        pair_friction: f64 [npair x 5], "Tangent1, 2, spin, roll1, 2";
        // excluded body pairs for collision detection
        exclude_signature: i32 [nexclude], "(body1+1)<<16 + body2+1";
        // equality constraints
        eq_type: i32 [neq], "Constraint type (mjtEq)";
        eq_obj1id: i32 [neq], "Id of object 1";
        eq_obj2id: i32 [neq], "Id of object 2";
        eq_solref: f64 [neq x 2], "Constraint solver reference";
        eq_solimp: f64 [neq x 5], "Constraint solver impedance";
        // tendons
        tendon_adr: i32 [ntendon], "Address of first object in tendon's path";
        tendon_num: i32 [ntendon], "Number of objects in tendon's path";
        tendon_group: i32 [ntendon], "Group for visibility";
        tendon_limited: u8 [ntendon], "Does tendon have length limits";
        tendon_width: f64 [ntendon], "Width for rendering";
        tendon_solref_lim: f64 [ntendon x 2], "Constraint solver reference: limit";
        tendon_solimp_lim: f64 [ntendon x 5], "Constraint solver impedance: limit";
        tendon_solref_fri: f64 [ntendon x 2], "Constraint solver reference: friction";
        tendon_solimp_fri: f64 [ntendon x 5], "Constraint solver impedance: friction";
        tendon_range: f64 [ntendon x 2], "Tendon length limits";
        tendon_margin: f64 [ntendon], "Min distance for limit detection";
        tendon_stiffness: f64 [ntendon], "Stiffness coefficient";
        tendon_damping: f64 [ntendon], "Damping coefficient";
        tendon_frictionloss: f64 [ntendon], "Loss due to friction";
        tendon_length0: f64 [ntendon], "Tendon length in qpos0";
        tendon_invweight0: f64 [ntendon], "Inv. weight in qpos0";
        tendon_rgba: f32 [ntendon x 4], "Rgba when material is omitted";
        // list of all wrap objects in tendon paths
        wrap_type: i32 [nwrap], "Wrap object type (mjtWrap)";
        wrap_objid: i32 [nwrap], "Object id: geom, site, joint";
        wrap_prm: f64 [nwrap], "Divisor, joint coef, or site id";
        // actuators
        actuator_trntype: i32 [nu], "Transmission type (mjtTrn)";
        actuator_dyntype: i32 [nu], "Dynamics type (mjtDyn)";
        actuator_gaintype: i32 [nu], "Gain type (mjtGain)";
        actuator_biastype: i32 [nu], "Bias type (mjtBias)";
        actuator_trnid: i32 [nu x 2], "Transmission id: joint, tendon, site";
        actuator_group: i32 [nu], "Group for visibility";
        actuator_ctrllimited: u8 [nu], "Is control limited";
        actuator_forcelimited: u8 [nu], "Is force limited";
        actuator_actlimited: u8 [nu], "Is activation limited";
        actuator_dynprm: f64 [nu x 10], "Dynamics parameters";
        actuator_gainprm: f64 [nu x 10], "Gain parameters";
        actuator_biasprm: f64 [nu x 10], "Bias parameters";
        actuator_ctrlrange: f64 [nu x 2], "Range of controls";
        actuator_forcerange: f64 [nu x 2], "Range of forces";
        actuator_actrange: f64 [nu x 2], "Range of activations";
        actuator_gear: f64 [nu x 6], "Scale length and transmitted force";
        actuator_cranklength: f64 [nu], "Crank length for slider-crank";
        actuator_acc0: f64 [nu], "Acceleration from unit force in qpos0";
        actuator_length0: f64 [nu], "Actuator length in qpos0";
        actuator_lengthrange: f64 [nu x 2], "Feasible actuator length range";
        // sensors
        sensor_type: i32 [nsensor], "Sensor type (mjtSensor)";
        sensor_datatype: i32 [nsensor], "Numeric data type (mjtDataType)";
        sensor_needstage: i32 [nsensor], "Required compute stage (mjtStage)";
        sensor_objtype: i32 [nsensor], "Type of sensorized object (mjtObj)";
        sensor_objid: i32 [nsensor], "Id of sensorized object";
        sensor_reftype: i32 [nsensor], "Type of reference frame (mjtObj)";
        sensor_refid: i32 [nsensor], "Id of reference frame; -1: global frame";
        sensor_dim: i32 [nsensor], "Number of scalar outputs";
        sensor_adr: i32 [nsensor], "Address in sensor array";
        sensor_cutoff: f64 [nsensor], "Cutoff for real and positive; 0: ignore";
        sensor_noise: f64 [nsensor], "Noise standard deviation";
        // custom numeric fields
        numeric_adr: i32 [nnumeric], "Address of field in numeric_data";
        numeric_size: i32 [nnumeric], "Size of numeric field";
        numeric_data: f64 [nnumericdata], "Array of all numeric fields";
        // keyframes
        key_time: f64 [nkey], "Key time";
        key_qpos: f64 [nkey x nq], "Key position";
        key_qvel: f64 [nkey x nv], "Key velocity";
        key_act: f64 [nkey x na], "Key activation";
        key_mpos: f64 [nkey x nmocap x 3], "Key mocap position";
        key_mquat: f64 [nkey x nmocap x 4], "Key mocap quaternion";
        key_ctrl: f64 [nkey x nu], "Key control";
    }

    /// Numeric data of each equality constraint. Shape: `neq x eq_data_stride()`. For a weld: anchor in body 2 (3),
    /// the same point in body 1 (3), orientation of body 2 in body 1 (4), torquescale.
    pub fn eq_data(&self) -> &[f64] {
        // SAFETY: as in `read_arrays!`, with the engine's number of columns.
        unsafe { slice(self.fields().eq_data, self.fields().neq as usize * compat::EQ_DATA) }
    }

    /// Numbers per equality constraint in [`eq_data`](Self::eq_data).
    pub fn eq_data_stride(&self) -> usize {
        compat::EQ_DATA
    }
}
