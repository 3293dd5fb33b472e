//! Rows as Parquet: one file, one row group, no compression; the same rows make the same bytes.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::record::Field;
use parquet::schema::types::{Type, TypePtr};

/// Values of one column.
#[derive(Clone, Debug)]
pub(super) enum Column {
    /// UTF-8.
    Text(Vec<Option<String>>),
    /// 64 bits.
    Number(Vec<Option<f64>>),
    /// 64 bits, never missing.
    Count(Vec<u64>),
}

impl Column {
    fn schema(&self, name: &str) -> Result<TypePtr, ParquetError> {
        let (physical, repetition, logical) = match self {
            Self::Text(_) => (Physical::BYTE_ARRAY, Repetition::OPTIONAL, Some(LogicalType::String)),
            Self::Number(_) => (Physical::DOUBLE, Repetition::OPTIONAL, None),
            Self::Count(_) => (Physical::INT64, Repetition::REQUIRED, Some(LogicalType::integer(64, false))),
        };
        let built = Type::primitive_type_builder(name, physical).with_repetition(repetition).with_logical_type(logical);
        built.build().map(Arc::new)
    }
}

/// The columns as the bytes of a file, with `notes` as its metadata.
///
/// # Errors
/// Columns of different lengths.
pub(super) fn encode(columns: &[(String, Column)], notes: &[(&str, String)]) -> Result<Vec<u8>, ParquetError> {
    let fields = columns.iter().map(|(name, column)| column.schema(name)).collect::<Result<_, _>>()?;
    let schema = Arc::new(Type::group_type_builder("grasps").with_fields(fields).build()?);
    let notes = notes.iter().map(|(key, value)| KeyValue::new((*key).to_owned(), value.clone())).collect();
    let properties = WriterProperties::builder()
        .set_created_by(concat!("mujoco-grasp ", env!("CARGO_PKG_VERSION")).into())
        .set_key_value_metadata(Some(notes))
        .build();
    let mut bytes = Vec::new();
    let mut file = SerializedFileWriter::new(&mut bytes, schema, Arc::new(properties))?;
    let mut group = file.next_row_group()?;
    for (_, column) in columns {
        let Some(mut writer) = group.next_column()? else { break };
        match column {
            Column::Text(values) => {
                let there: Vec<ByteArray> = values.iter().flatten().map(|text| text.as_str().into()).collect();
                writer.typed::<ByteArrayType>().write_batch(&there, Some(&levels(values)), None)?;
            }
            Column::Number(values) => {
                let there: Vec<f64> = values.iter().flatten().copied().collect();
                writer.typed::<DoubleType>().write_batch(&there, Some(&levels(values)), None)?;
            }
            Column::Count(values) => {
                let there: Vec<i64> = values.iter().map(|n| n.cast_signed()).collect();
                writer.typed::<Int64Type>().write_batch(&there, None, None)?;
            }
        }
        writer.close()?;
    }
    group.close()?;
    file.close()?;
    Ok(bytes)
}

/// 1 for what is there, 0 for null.
fn levels<T>(values: &[Option<T>]) -> Vec<i16> {
    values.iter().map(|value| i16::from(value.is_some())).collect()
}

/// Gives a file its name once all of its bytes are on the disk.
///
/// # Errors
/// The system's.
pub(super) fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    crate::whole_file::write_whole(path, |file| file.write_all(bytes))
}

/// A file that is there, to be read.
pub(super) struct Reader(SerializedFileReader<File>);

impl Reader {
    /// # Errors
    /// The system's, and for what is no Parquet file.
    pub fn open(path: &Path) -> io::Result<Self> {
        SerializedFileReader::new(File::open(path)?).map(Self).map_err(io::Error::other)
    }

    /// A note of its metadata.
    pub fn note(&self, key: &str) -> Option<&str> {
        let notes = self.0.metadata().file_metadata().key_value_metadata()?;
        notes.iter().find(|note| note.key == key)?.value.as_deref()
    }

    /// The values of the column `name`.
    ///
    /// # Errors
    /// A file without that column, or a damaged one.
    pub fn column(&self, name: &str) -> io::Result<Vec<Field>> {
        let schema = self.0.metadata().file_metadata().schema();
        let one = schema.get_fields().iter().filter(|field| field.name() == name).cloned().collect();
        let projection = Type::group_type_builder(schema.name()).with_fields(one).build().map_err(io::Error::other)?;
        let rows = self.0.get_row_iter(Some(projection)).map_err(io::Error::other)?;
        rows.map(|row| {
            let row = row.map_err(io::Error::other)?;
            let value = row.get_column_iter().next().map(|(_, value)| value.clone());
            value.ok_or_else(|| io::Error::other(format!("it has no column {name}")))
        })
        .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_and_the_same_again() {
        let columns = [
            ("a".to_owned(), Column::Text(vec![Some("x".into()), None, Some("y".into())])),
            ("b:c".to_owned(), Column::Number(vec![None, Some(-0.5), Some(1e-300)])),
            ("n".to_owned(), Column::Count(vec![0, 7, u64::MAX])),
        ];
        let bytes = encode(&columns, &[("k", "v".into())]).unwrap();
        assert_eq!(bytes, encode(&columns, &[("k", "v".into())]).unwrap());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.parquet");
        write(&path, &bytes).unwrap();
        let reader = Reader::open(&path).unwrap();
        assert_eq!((reader.note("k"), reader.note("v")), (Some("v"), None));
        assert_eq!(reader.column("a").unwrap(), [Field::Str("x".into()), Field::Null, Field::Str("y".into())]);
        assert_eq!(reader.column("b:c").unwrap(), [Field::Null, Field::Double(-0.5), Field::Double(1e-300)]);
        assert_eq!(reader.column("n").unwrap(), [Field::ULong(0), Field::ULong(7), Field::ULong(u64::MAX)]);
        for end in [0, 3, bytes.len() / 2, bytes.len() - 1] {
            std::fs::write(&path, &bytes[..end]).unwrap();
            assert!(Reader::open(&path).is_err(), "a file cut at {end} is read");
        }
    }
}
