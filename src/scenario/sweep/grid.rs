//! From the families of a spec to its grasps.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::Serialize;

use super::file::{FamilyEntry, Range, SweepFile, Values, is_factor};
use crate::scenario::error::{Error, Field};

/// More grasps than this are a slip of the pen.
const MOST: usize = 10_000_000;

/// One grasp of a sweep.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Case {
    /// FAMILY/NUMBER, from 0.
    pub id: String,
    /// Keyframe that it starts from; `None`: the scenario's start.
    pub keyframe: Option<String>,
    /// Value of each parameter of the sweep; `None`: as the model has it.
    pub values: Vec<Option<f64>>,
}

/// Lines of a table: names, and a value of each in each line.
struct Table {
    names: Vec<String>,
    lines: Vec<Vec<f64>>,
}

/// Names of all parameters, sorted, with the field that has each, and all grasps in the order of the spec.
///
/// # Errors
/// [`Error::Field`]: tables that cannot be read, or that name what `set` has too; too many grasps.
pub(super) fn expand(spec: &SweepFile, path: &Path) -> Result<(BTreeMap<String, String>, Vec<Case>), Error> {
    let tables: Vec<Option<Table>> = spec
        .grasp
        .iter()
        .enumerate()
        .map(|(i, family)| {
            let field = Field::new(path, &format!("grasp[{i}].table"));
            family.table.as_ref().map(|table| Table::read(path, table, family, field)).transpose()
        })
        .collect::<Result<_, _>>()?;
    let mut fields = BTreeMap::new();
    for (i, (family, table)) in spec.grasp.iter().zip(&tables).enumerate() {
        let set = family.set.keys().map(|name| (name.clone(), format!("grasp[{i}].set.\"{name}\"")));
        let columns = table.iter().flat_map(|table| &table.names);
        let columns = columns.map(|name| (name.clone(), format!("grasp[{i}].table: the column \"{name}\"")));
        set.chain(columns).for_each(|(name, field)| _ = fields.entry(name).or_insert(field));
    }
    let names: Vec<String> = fields.keys().cloned().collect();
    let mut cases = Vec::new();
    for (i, (family, table)) in spec.grasp.iter().zip(&tables).enumerate() {
        let count = count(family, table.as_ref());
        if count.is_none_or(|count| cases.len() + count > MOST) {
            return Err(Field::new(path, &format!("grasp[{i}]")).wrong(format!("makes more than {MOST} grasps")));
        }
        add(spec.seed, family, table.as_ref(), &names, &mut cases);
    }
    Ok((fields, cases))
}

/// Grasps of a family; `None` where it is no number.
fn count(family: &FamilyEntry, table: Option<&Table>) -> Option<usize> {
    let lists = family.set.values().map(|values| if let Values::Each(list) = values { list.len() } else { 1 });
    let rest = [family.keyframes.len().max(1), table.map_or(1, |t| t.lines.len()), family.samples.unwrap_or(1)];
    lists.chain(rest).try_fold(1_usize, usize::checked_mul)
}

/// Keyframes vary slowest, then the table's lines, then the lists in order of their names, then the samples.
fn add(seed: u64, family: &FamilyEntry, table: Option<&Table>, names: &[String], cases: &mut Vec<Case>) {
    // every name that is looked up here is one of `names`
    let column = |name: &String| names.binary_search(name).unwrap_or_default();
    let keyframes: Vec<Option<&String>> =
        if family.keyframes.is_empty() { vec![None] } else { family.keyframes.iter().map(Some).collect() };
    let empty = Table { names: Vec::new(), lines: vec![Vec::new()] };
    let table = table.unwrap_or(&empty);
    let lists: Vec<(usize, &[f64])> = family
        .set
        .iter()
        .filter_map(|(name, values)| match values {
            Values::One(value) => Some((column(name), std::slice::from_ref(value))),
            Values::Each(list) => Some((column(name), list.as_slice())),
            Values::Drawn(_) => None,
        })
        .collect();
    let drawn: Vec<(usize, Range)> = family
        .set
        .iter()
        .filter_map(
            |(name, values)| if let Values::Drawn(range) = values { Some((column(name), *range)) } else { None },
        )
        .collect();
    let points: usize = lists.iter().map(|(_, list)| list.len()).product();
    let first = cases.len();
    for keyframe in &keyframes {
        for line in &table.lines {
            for point in 0..points {
                for _ in 0..family.samples.unwrap_or(1) {
                    let id = format!("{}/{}", family.name, cases.len() - first);
                    let mut values = vec![None; names.len()];
                    for (name, value) in table.names.iter().zip(line) {
                        values[column(name)] = Some(*value);
                    }
                    let mut rest = point;
                    for &(column, list) in lists.iter().rev() {
                        values[column] = Some(list[rest % list.len()]);
                        rest /= list.len();
                    }
                    let mut draw = draws(seed, &id);
                    for &(column, Range { min, max }) in &drawn {
                        values[column] = Some(min + draw() * (max - min));
                    }
                    cases.push(Case { id, keyframe: keyframe.cloned(), values });
                }
            }
        }
    }
}

/// Numbers from 0 to below 1 for one grasp: they depend on seed and id alone.
fn draws(seed: u64, id: &str) -> impl FnMut() -> f64 + use<> {
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    let mut rng = ChaCha8Rng::from_seed(key);
    rng.set_stream(checksum(id.bytes()));
    move || (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

/// FNV-1a.
pub(super) fn checksum(bytes: impl Iterator<Item = u8>) -> u64 {
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3))
}

impl Table {
    fn read(spec: &Path, table: &Path, family: &FamilyEntry, field: Field<'_>) -> Result<Self, Error> {
        let path: PathBuf = spec.parent().unwrap_or(Path::new("")).join(table);
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(e) => return Err(field.wrong(format!("is {}, which cannot be read: {e}", path.display()))),
        };
        match Self::parse(&text) {
            Ok(read) => match read.names.iter().find(|name| family.set.contains_key(*name)) {
                Some(name) => Err(field.wrong(format!("has a column {name}, which `set` gives too"))),
                None => Ok(read),
            },
            Err(problem) => Err(field.wrong(format!("is {}: {problem}", path.display()))),
        }
    }

    fn parse(text: &str) -> Result<Self, String> {
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
        let names: Vec<String> = reader.headers().map_err(|e| e.to_string())?.iter().map(str::to_owned).collect();
        let distinct: BTreeSet<&String> = names.iter().collect();
        if distinct.len() < names.len() {
            return Err("its first line names a parameter twice".into());
        }
        let mut lines = Vec::new();
        for (i, record) in reader.records().enumerate() {
            let record = record.map_err(|e| e.to_string())?;
            let number = |(name, cell): (&String, &str)| match cell.parse::<f64>() {
                Ok(value) if value < 0.0 && is_factor(name) => {
                    Err(format!("line {}: {name} is {cell}; it must be 0 or above", i + 2))
                }
                Ok(value) if value.is_finite() => Ok(value),
                _ => Err(format!("line {}: {cell:?} is no finite number", i + 2)),
            };
            lines.push(names.iter().zip(record.iter()).map(number).collect::<Result<_, _>>()?);
        }
        if lines.is_empty() {
            return Err("it has no line after the one that names parameters".into());
        }
        Ok(Self { names, lines })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cases(grasps: &str) -> (Vec<String>, Vec<Case>) {
        let text = format!(
            "name = \"s\"\nscenario = \"x.toml\"\nseed = 3\n{grasps}\n[[load]]\nname = \"l\"\nduration = 1.0\nforce = [1, 0, 0]\n"
        );
        let path = Path::new("s.toml");
        let (fields, cases) = expand(&SweepFile::parse(&text, path).unwrap(), path).unwrap();
        (fields.into_keys().collect(), cases)
    }

    const GRID: &str =
        "[[grasp]]\nname = \"a\"\nkeyframes = [\"k\", \"l\"]\nset = { y = [1, 2, 3], x = [0.5, 0.25], z = 7 }";

    #[test]
    fn a_grid_has_every_combination_once_the_last_name_quickest() {
        let (names, cases) = cases(GRID);
        assert_eq!(names, ["x", "y", "z"]);
        assert_eq!(cases.len(), 12);
        assert_eq!(cases[0].values, [Some(0.5), Some(1.0), Some(7.0)]);
        assert_eq!(cases[1].values, [Some(0.5), Some(2.0), Some(7.0)]);
        assert_eq!(cases[3].values, [Some(0.25), Some(1.0), Some(7.0)]);
        assert_eq!((cases[5].keyframe.as_deref(), cases[6].keyframe.as_deref()), (Some("k"), Some("l")));
        for (i, case) in cases.iter().enumerate() {
            assert_eq!(case.id, format!("a/{i}"));
            assert!(cases[..i].iter().all(|c| (&c.keyframe, &c.values) != (&case.keyframe, &case.values)));
        }
    }

    #[test]
    fn draws_stay_in_their_range_and_depend_on_seed_and_id_alone() {
        let drawn = "[[grasp]]\nname = \"b\"\nsamples = 500\nset = { x = { min = -1.0, max = 3.0 } }";
        let (_, alone) = cases(drawn);
        let (_, after) = cases(&format!("{GRID}\n{drawn}"));
        assert_eq!(after.len(), 512);
        let xs: Vec<f64> = alone.iter().map(|c| c.values[0].unwrap()).collect();
        let mean = xs.iter().sum::<f64>() / 500.0;
        assert!(xs.iter().all(|x| (-1.0..3.0).contains(x)) && (mean - 1.0).abs() < 0.2, "{mean}");
        for (a, b) in alone.iter().zip(&after[12..]) {
            assert_eq!((&a.id, a.values[0]), (&b.id, b.values[0]));
        }
        assert_ne!(draws(3, "b/0")(), draws(4, "b/0")());
    }

    #[test]
    fn a_table_gives_its_lines_and_says_where_it_is_wrong() {
        let table = Table::parse("x, y\n1, 2\n3,4e-1\n").unwrap();
        assert_eq!((table.names, table.lines), (vec!["x".into(), "y".into()], vec![vec![1.0, 2.0], vec![3.0, 0.4]]));
        for (text, problem) in [
            ("x\n1\nnan\n", "line 3"),
            ("x,x\n1,2\n", "twice"),
            ("x\n", "no line"),
            ("x\n1,2\n", "fields"),
            ("friction\n-1\n", "line 2: friction"),
        ] {
            let Err(said) = Table::parse(text) else { panic!("{text} is read") };
            assert!(said.contains(problem), "{said}");
        }
    }

    #[test]
    fn too_many_grasps_are_refused_before_they_are_made() {
        let list = "[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]";
        let set: Vec<String> = (0..30).map(|i| format!("p{i} = {list}")).collect();
        let text = format!(
            "name = \"s\"\nscenario = \"x\"\n[[grasp]]\nname = \"a\"\nset = {{ {} }}\n[[load]]\nname = \"l\"\nduration = 1.0\nforce = [1, 0, 0]\n",
            set.join(", ")
        );
        let path = Path::new("s.toml");
        let error = expand(&SweepFile::parse(&text, path).unwrap(), path).unwrap_err();
        assert!(error.to_string().contains("grasp[0] makes more than"), "{error}");
    }
}
