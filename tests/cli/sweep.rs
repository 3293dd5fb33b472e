//! `sweep`: what rows say is true, and they are the same however the work is divided, ended and taken up again.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::page::{collect, named, page};
use crate::program::call_in;
use mujoco_grasp::scenario::runner::Mode;
use mujoco_grasp::scenario::sweep::{self, Report, Shard, Sweep};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;

/// A sweep of `grasps` with `loads`, in a folder of its own.
fn spec(folder: &Path, grasps: &str, loads: &str) -> PathBuf {
    spec_of(&Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/sweep/lift.toml"), folder, grasps, loads)
}

fn spec_of(scenario: &Path, folder: &Path, grasps: &str, loads: &str) -> PathBuf {
    let text = format!(
        "name = \"test\"\nscenario = {:?}\nseed = 5\ngrasps_per_file = 4\n{grasps}\n{loads}",
        scenario.to_str().unwrap()
    );
    let path = folder.join("spec.toml");
    std::fs::write(&path, text).unwrap();
    path
}

const DRAWN: &str = "[[grasp]]\nname = \"drawn\"\nsamples = 30\nset = { \"pose:ball:x\" = { min = -0.005, max = 0.005 }, \
    \"pose:ball:y\" = { min = -0.006, max = 0.006 }, strength = { min = 0.5, max = 1.5 }, \
    friction = { min = 0.4, max = 1.2 } }";

const SHAKES: &str = "[[load]]\nname = \"shake-x\"\nduration = 1.0\nfrequency = 3.0\nacceleration = [12.0, 0.0, 0.0]\n\
    [[load]]\nname = \"shake-z\"\nduration = 1.0\nfrequency = 3.0\nacceleration = [0.0, 0.0, 12.0]\n\
    [[load]]\nname = \"pull\"\nduration = 0.5\nforce = [0.0, 0.0, -0.6]\n\
    [[load]]\nname = \"twist\"\nduration = 0.5\ntorque = [0.002, 0.0, 0.0]\n";

type Rows = Vec<BTreeMap<String, Field>>;

/// All rows of a folder, in the order of its files.
fn rows(out: &Path) -> Rows {
    files(out)
        .keys()
        .flat_map(|name| {
            let file = std::fs::File::open(out.join(name)).unwrap();
            let reader = SerializedFileReader::new(file).unwrap();
            let rows = reader.get_row_iter(None).unwrap().map(|row| row.unwrap());
            rows.map(|row| row.get_column_iter().map(|(name, value)| (name.clone(), value.clone())).collect())
                .collect::<Rows>()
        })
        .collect()
}

/// Name and bytes of every finished file.
fn files(out: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(out).into_iter().flatten().map(|entry| entry.unwrap().path());
    let finished = entries.filter(|path| path.extension().is_some_and(|e| e == "parquet"));
    finished
        .map(|path| (path.file_name().unwrap().to_str().unwrap().to_owned(), std::fs::read(path).unwrap()))
        .collect()
}

fn run(spec: &Path, mode: Mode, out: &Path) -> Report {
    sweep::run(&Sweep::load(spec).unwrap(), mode, Shard::ALL, out, &|_| ()).unwrap()
}

fn text(row: &BTreeMap<String, Field>, name: &str) -> String {
    match &row[name] {
        Field::Str(text) => text.clone(),
        other => panic!("{name} is {other:?}"),
    }
}

fn number(row: &BTreeMap<String, Field>, name: &str) -> f64 {
    match row[name] {
        Field::Double(value) => value,
        ref other => panic!("{name} is {other:?}"),
    }
}

#[test]
fn both_modes_give_the_same_verdicts_and_grasp_mode_is_latched() {
    let folder = tempfile::tempdir().unwrap();
    let spec = spec(folder.path(), DRAWN, SHAKES);
    let [full, grasp] = [Mode::Full, Mode::Grasp].map(|mode| {
        let out = folder.path().join(mode.name());
        let report = run(&spec, mode, &out);
        assert_eq!((report.grasps, report.tested, report.files), (30, 30, 8));
        (report, rows(&out))
    });
    for verdict in ["held", "lost"] {
        assert!(full.0.verdicts[verdict] >= 4, "the sweep tells little: {:?}", full.0.verdicts);
    }
    let alike = full.1.iter().zip(&grasp.1).filter(|(a, b)| a["verdict"] == b["verdict"]).count();
    assert!(alike >= 29, "{alike} of 30 verdicts alike: {:?} {:?}", full.0.verdicts, grasp.0.verdicts);
    assert!(grasp.0.latched_share.p10.unwrap() > 0.95, "{:?}", grasp.0.latched_share);
    assert_eq!(full.0.latched_share.median, None);
    for (full, grasp) in
        full.1.iter().zip(&grasp.1).filter(|(a, b)| text(a, "verdict") == "held" && a["verdict"] == b["verdict"])
    {
        let id = text(full, "id");
        assert!(number(grasp, "substructured_share") > 0.5, "{id}: a shake makes every step a whole one");
        assert!(number(grasp, "quality_at_latch_n") > 0.0 && number(grasp, "latched_at_s") < 1.2, "{id}");
        let (a, b) = (number(full, "max_motion_m"), number(grasp, "max_motion_m"));
        assert!((a - b).abs() < 0.02 * a, "{id} moves {a} m in full mode and {b} m in grasp mode");
        assert_eq!((&full["steps"], &full["lost_in"]), (&grasp["steps"], &Field::Null), "{id}");
    }
}

/// The gripper of the examples with flat fingertips and a cube, which does not roll off them, in `folder`.
fn flat_gripper(folder: &Path) -> PathBuf {
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
    let copy = |from: &str, to: &str, changes: &[(&str, &str)]| {
        let mut text = std::fs::read_to_string(examples.join(from)).unwrap();
        for (from, to) in changes {
            assert!(text.contains(from), "{from}");
            text = text.replace(from, to);
        }
        std::fs::write(folder.join(to), text).unwrap();
        folder.join(to)
    };
    let flat = "type=\"box\" size=\"0.012 0.02 0.02\" mass=\"0.05\"";
    let cube = "type=\"box\" size=\"0.03 0.03 0.03\" mass=\"0.1\"";
    copy("gripper.xml", "flat.xml", &[("size=\"0.012\" mass=\"0.05\"", flat), ("size=\"0.03\" mass=\"0.1\"", cube)]);
    copy("sweep/lift.toml", "flat.toml", &[("../gripper.xml", "flat.xml")])
}

/// Two fingertips hold a weight m (g + a) as long as it is below friction times both normal forces.
#[test]
fn a_load_is_as_large_as_it_says_and_points_where_it_says() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = flat_gripper(folder.path());
    let one = "[[grasp]]\nname = \"one\"\nset = { friction = 0.5 }";
    let (mass, weight) = (0.1, 0.981);
    let load = |key: &str, z: f64| format!("[[load]]\nname = \"l\"\nduration = 0.5\n{key} = [0.0, 0.0, {z}]\n");
    let tried = |key: &str, z: f64, mode: Mode| {
        let out = tempfile::tempdir_in(folder.path()).unwrap();
        run(&spec_of(&scenario, folder.path(), one, &load(key, z)), mode, out.path());
        rows(out.path()).remove(0)
    };
    for mode in [Mode::Full, Mode::Grasp] {
        let pressed = number(&tried("force", -1e-6, mode), "normal_force_n");
        let most = 0.5 * pressed - weight;
        assert!(most > 0.3, "{pressed} N");
        for (key, unit) in [("force", -1.0), ("acceleration", 1.0 / mass)] {
            for (share, verdict) in [(0.93, "held"), (1.25, "lost"), (-1.0, "held")] {
                let row = tried(key, unit * share * most, mode);
                assert_eq!(text(&row, "verdict"), verdict, "{mode:?} {key} at {share} of the most: {row:?}");
                if verdict == "lost" {
                    assert_eq!(text(&row, "lost_in"), "l");
                    let at = number(&row, "lost_at_s");
                    // the loads begin after 1.2 s, and it takes a while to move it 5 cm
                    assert!((1.25..1.95).contains(&at) && number(&row, "max_slip_m") > 0.045, "{row:?}");
                }
            }
        }
    }
}

#[test]
fn rows_depend_neither_on_shards_nor_on_threads() {
    let folder = tempfile::tempdir().unwrap();
    let spec = spec(folder.path(), DRAWN, SHAKES);
    let call = |out: &str, threads: &str, shard: &str| {
        let status = Command::new(env!("CARGO_BIN_EXE_mujoco-grasp"))
            .args(["sweep", spec.to_str().unwrap(), "--out", out, "--shard", shard])
            .current_dir(folder.path())
            .env("RAYON_NUM_THREADS", threads)
            .stdout(Stdio::null())
            .status();
        assert!(status.unwrap().success());
    };
    call("whole", "1", "0/1");
    for shard in ["2/3", "0/3", "1/3"] {
        call("shards", "3", shard);
    }
    let [whole, shards] = ["whole", "shards"].map(|out| files(&folder.path().join(out)));
    assert_eq!(whole.len(), 8);
    assert!(whole == shards, "the files differ");
}

/// A process that is killed leaves finished files and others; the same call makes the rest.
#[test]
fn a_sweep_that_is_killed_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let many = DRAWN.replace("samples = 30", "samples = 80");
    let spec = spec(folder.path(), &many, SHAKES);
    for (signal, status) in [("KILL", None), ("INT", Some(130))] {
        let out = folder.path().join(signal);
        let mut child = Command::new(env!("CARGO_BIN_EXE_mujoco-grasp"))
            .args(["sweep", spec.to_str().unwrap(), "--out", out.to_str().unwrap()])
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let deadline = Instant::now() + Duration::from_secs(60);
        while files(&out).len() < 3 && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(5));
        }
        assert!(Command::new("kill").args(["-s", signal, &child.id().to_string()]).status().unwrap().success());
        assert_eq!(child.wait().unwrap().code(), status);
        let before = files(&out);
        assert!((3..20).contains(&before.len()), "{} of 20 files are finished after SIG{signal}", before.len());
        let report = run(&spec, Mode::Grasp, &out);
        assert_eq!((report.grasps, report.tested), (80, 80 - 4 * before.len()), "SIG{signal}");
        assert_eq!(report.verdicts.values().sum::<usize>(), 80);
        assert!(before.iter().all(|(name, bytes)| files(&out)[name] == *bytes));
    }
    let undisturbed = folder.path().join("undisturbed");
    run(&spec, Mode::Grasp, &undisturbed);
    for signal in ["KILL", "INT"] {
        assert!(files(&folder.path().join(signal)) == files(&undisturbed), "SIG{signal}");
    }
}

const ONE: &str = "[[grasp]]\nname = \"one\"\n";
const PUSH: &str = "[[load]]\nname = \"l\"\nduration = 0.1\nforce = [1, 0, 0]\n";

#[track_caller]
fn refused(spec: &Path, options: &[&str], parts: &[&str]) {
    let folder = spec.parent().unwrap();
    // into out/test, after the spec's name, unless the options say otherwise
    let called = call_in(folder, &[&["sweep", spec.to_str().unwrap(), "--json"], options].concat());
    assert_eq!(called.status, 2, "{}", called.stderr);
    let message = called.json()["error"].as_str().unwrap().to_owned();
    assert!(parts.iter().all(|part| message.contains(part)), "{parts:?} are not in: {message}");
}

#[test]
fn files_of_another_sweep_are_neither_taken_nor_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let path = spec(folder.path(), ONE, PUSH);
    let out = folder.path().join("out/test");
    run(&path, Mode::Grasp, &out);
    let first = files(&out);
    refused(&path, &["--mode", "full"], &["part-00000.parquet", "its mode is grasp, not full", "another folder"]);
    spec(folder.path(), ONE, &PUSH.replace("[1, 0, 0]", "[2, 0, 0]"));
    refused(&path, &[], &["part-00000.parquet", "of another sweep", "its spec"]);
    spec(folder.path(), ONE, PUSH);
    let table = |text: &str| {
        std::fs::write(folder.path().join("t.csv"), text).unwrap();
        spec(folder.path(), "[[grasp]]\nname = \"one\"\ntable = \"t.csv\"", PUSH)
    };
    let tabled = folder.path().join("tabled");
    run(&table("friction\n1\n"), Mode::Grasp, &tabled);
    refused(&table("friction\n2\n"), &["--out", "tabled"], &["another sweep", "its grasps"]);
    assert!(files(&out) == first);

    let bytes = &first["part-00000.parquet"];
    std::fs::write(out.join("part-00000.parquet"), &bytes[..bytes.len() - 9]).unwrap();
    refused(&spec(folder.path(), ONE, PUSH), &[], &["part-00000.parquet", "is no file of a sweep"]);
}

#[test]
fn a_shard_without_grasps_is_not_one_that_did_not_latch() {
    let folder = tempfile::tempdir().unwrap();
    let path = spec(folder.path(), ONE, PUSH);
    let called = call_in(folder.path(), &["sweep", path.to_str().unwrap(), "--shard", "5/9"]);
    assert!(
        called.stderr.contains("the shard has no grasps") && !called.stderr.contains("latched"),
        "{}",
        called.stderr
    );
}

#[test]
fn bad_specs_are_told_what_would_be_right() {
    let folder = tempfile::tempdir().unwrap();
    let with = |set: &str| format!("[[grasp]]\nname = \"one\"\nset = {{ {set} }}\n");
    let ones = format!("{ONE}{ONE}");
    let pushes = format!("{PUSH}{PUSH}");
    for (grasps, loads, parts) in [
        ("", PUSH, &["spec.toml: grasp is missing", "[[grasp]]"][..]),
        (ONE, "", &["load is missing", "[[load]]"]),
        (&ones, PUSH, &["grasp[1].name", "another [[grasp]]"]),
        (ONE, &pushes, &["load[1].name", "another [[load]]"]),
        (ONE, "[[load]]\nname = \"l\"\nduration = 1.0\n", &["load[0].force", "acceleration"]),
        (ONE, "[[load]]\nname = \"l\"\nduration = 0\nforce = [1, 0, 0]\n", &["load[0].duration", "above 0"]),
        (ONE, "[[load]]\nname = \"l\"\nlength = 1\n", &["length", "unknown field"]),
        ("grasps_per_file = 2\n", PUSH, &["duplicate key"]),
        (&with("\"joint:leftt\" = 1"), PUSH, &["grasp[0].set.\"joint:leftt\" is unknown", "left"]),
        (&with("friction = \"high\""), PUSH, &["expected a number, a list of numbers"]),
        (&with("friction = []"), PUSH, &["set.\"friction\"", "empty list"]),
        (&with("friction = { min = 2, max = 1 }"), PUSH, &["goes from 2.0 to 1.0"]),
        (&with("friction = [1, -1]"), PUSH, &["spec.toml: grasp[0].set.\"friction\" is -1.0", "0 or above"]),
        (&with("strength = { min = -1, max = 1 }"), PUSH, &["grasp[0].set.\"strength\" is -1.0", "0 or above"]),
        ("[[grasp]]\nname = \"one\"\nsamples = 3", PUSH, &["grasp[0].samples", "min, max"]),
        ("[[grasp]]\nname = \"one\"\nkeyframes = [\"home\"]", PUSH, &["grasp[0].keyframes[0]", "home"]),
        ("[[grasp]]\nname = \"one\"\ntable = \"no.csv\"", PUSH, &["grasp[0].table", "no.csv"]),
    ] {
        refused(&spec(folder.path(), grasps, loads), &[], parts);
    }
    let lost = spec_of(Path::new("nope.toml"), folder.path(), ONE, PUSH);
    refused(&lost, &[], &["spec.toml: scenario is \"nope.toml\"", "built in are"]);
    let good = spec(folder.path(), ONE, PUSH);
    refused(&good, &["--shard", "2/2"], &["--shard", "2/2", "from 0 to N - 1"]);
    refused(&folder.path().join("none.toml"), &[], &["none.toml", "cannot be read"]);
    assert!(!folder.path().join("out").exists(), "bad input leaves no folder of results");
}

#[test]
fn every_key_and_column_is_on_the_page() {
    let folder = tempfile::tempdir().unwrap();
    let path = spec(folder.path(), "[[grasp]]\nname = \"one\"\nset = { friction = 1 }", PUSH);
    let called = call_in(folder.path(), &["sweep", path.to_str().unwrap(), "--out", "out", "--json"]);
    assert_eq!(called.status, 0, "{}", called.stderr);
    let page = page("sweep.md");
    let mut names = std::collections::BTreeSet::new();
    let mut json = called.json();
    json.as_object_mut().unwrap().remove("verdicts");
    collect(&json, &mut names);
    named(&page, names);
    named(&page, ["verdicts", "held", "slid", "lost", "missed", "failed"].map(str::to_owned));
    named(&page, rows(&folder.path().join("out"))[0].keys().cloned());
    let spec = Sweep::load(&path).unwrap().spec;
    let mut keys = std::collections::BTreeSet::new();
    collect(&serde_json::to_value(&spec).unwrap(), &mut keys);
    named(&page, keys);
}

/// The example of the README and of docs/sweep.md.
#[test]
fn the_example_has_grasps_that_survive_and_grasps_that_do_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/sweep/ball.toml");
    let report = run(&path, Mode::Grasp, folder.path());
    assert!(report.verdicts["held"] >= 20 && report.verdicts["lost"] >= 20, "{:?}", report.verdicts);
    assert!(report.latched_share.median.unwrap() > 0.95, "{report:?}");
}
