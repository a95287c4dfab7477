//! Nested columns to and from Parquet.
//!
//! Parquet stores the leaves of nested columns alone, and with every value two levels: the definition level counts the
//! optional and repeated nodes above it that are there, the repetition level tells at which list the value goes on
//! (0: a new row). Lists are groups of three nodes, `list: repeated { element }`, as the format's logical types define them.

use std::borrow::Cow;
use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use parquet::basic::{ConvertedType, LogicalType, Repetition, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::{
    BoolType, ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int32Type, Int64Type,
};
use parquet::errors::{ParquetError, Result};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::FileReader;
use parquet::file::serialized_reader::SerializedFileReader;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::{Type, TypePtr};

use super::guard;
use super::table::{Column, List, Table, Values};
use crate::DatasetError;

/// Writes tables of the same columns as the row groups of one file.
pub(super) struct TableWriter<W: std::io::Write + Send> {
    writer: SerializedFileWriter<W>,
}

impl<W: std::io::Write + Send> TableWriter<W> {
    /// `table` has the columns, with or without rows.
    pub(super) fn new(file: W, table: &Table, properties: WriterProperties) -> Result<Self> {
        let fields = table.columns.iter().map(|c| type_of(c).map(Arc::new));
        let schema = Type::group_type_builder("schema")
            .with_fields(fields.collect::<Result<_>>()?)
            .build()?;
        let writer = SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties))?;
        Ok(Self { writer })
    }

    /// Writes a row group.
    pub(super) fn write(&mut self, table: &Table) -> Result<()> {
        let mut group = self.writer.next_row_group()?;
        for column in &table.columns {
            for path in leaves_of(column) {
                let leaf = Leaf::of(column, &path)?;
                let mut writer = group.next_column()?.ok_or_else(|| {
                    ParquetError::General(format!("column `{}` is not in the schema", column.name))
                })?;
                leaf.write(&mut writer)?;
                writer.close()?;
            }
        }
        group.close()?;
        Ok(())
    }

    /// Adds metadata of the file.
    pub(super) fn add_metadata(&mut self, key: &str, value: String) {
        let value = KeyValue::new(key.to_string(), value);
        self.writer.append_key_value_metadata(value);
    }

    /// Writes the end of the file.
    pub(super) fn close(self) -> Result<()> {
        self.writer.close().map(|_| ())
    }
}

fn type_of(column: &Column) -> Result<Type> {
    let repetition = match column.validity {
        Some(_) => Repetition::OPTIONAL,
        None => Repetition::REQUIRED,
    };
    let primitive = |physical: Physical, logical: Option<LogicalType>| {
        Type::primitive_type_builder(&column.name, physical)
            .with_repetition(repetition)
            .with_logical_type(logical)
            .build()
    };
    let group = |logical: Option<LogicalType>, fields: Vec<TypePtr>| {
        Type::group_type_builder(&column.name)
            .with_repetition(repetition)
            .with_logical_type(logical)
            .with_fields(fields)
            .build()
    };
    match &column.values {
        Values::Bool(_) => primitive(Physical::BOOLEAN, None),
        Values::I32(_) => primitive(Physical::INT32, None),
        Values::U32(_) => primitive(Physical::INT32, Some(LogicalType::integer(32, false))),
        Values::I64(_) => primitive(Physical::INT64, None),
        Values::U64(_) => primitive(Physical::INT64, Some(LogicalType::integer(64, false))),
        Values::F32(_) => primitive(Physical::FLOAT, None),
        Values::F64(_) => primitive(Physical::DOUBLE, None),
        Values::Text(_) => primitive(Physical::BYTE_ARRAY, Some(LogicalType::String)),
        Values::List(lists) => {
            let repeated = Type::group_type_builder("list")
                .with_repetition(Repetition::REPEATED)
                .with_fields(vec![Arc::new(type_of(lists.element())?)])
                .build()?;
            group(Some(LogicalType::List), vec![Arc::new(repeated)])
        }
        Values::Struct(members) => {
            let members = members.iter().map(|m| type_of(m).map(Arc::new));
            group(None, members.collect::<Result<_>>()?)
        }
    }
}

/// The leaves of a column in the order of the schema: of each, the members to take on the way down.
fn leaves_of(column: &Column) -> Vec<Vec<usize>> {
    match &column.values {
        Values::List(lists) => leaves_of(lists.element()),
        Values::Struct(members) => {
            let leaves = members.iter().enumerate().flat_map(|(i, member)| {
                leaves_of(member).into_iter().map(move |mut path| {
                    path.insert(0, i);
                    path
                })
            });
            leaves.collect()
        }
        _ => vec![Vec::new()],
    }
}

/// A leaf that is written: its column, and the levels of its entries, where they are not always zero.
struct Leaf<'a> {
    column: &'a Column,
    definition: Vec<i16>,
    repetition: Vec<i16>,
    /// Whether a list is above it, and whether that or an optional node is.
    has_repetition: bool,
    has_definition: bool,
}

impl<'a> Leaf<'a> {
    fn of(column: &'a Column, path: &[usize]) -> Result<Self> {
        let mut leaf = Self {
            column,
            definition: Vec::new(),
            repetition: Vec::new(),
            has_repetition: false,
            has_definition: false,
        };
        leaf.find(column, path)?;
        let top = Place {
            definition: 0,
            first: 0,
            depth: 0,
        };
        leaf.walk(column, 0..column.len(), top, path)?;
        Ok(leaf)
    }

    /// Adds the levels of the rows of a node.
    fn walk(
        &mut self,
        column: &Column,
        rows: Range<usize>,
        at: Place,
        path: &[usize],
    ) -> Result<()> {
        let is_optional = i16::from(column.validity.is_some());
        let present = at.definition + is_optional;
        let repetition = |row: usize| match row == rows.start {
            true => at.first,
            false => at.depth,
        };
        match &column.values {
            Values::List(lists) => {
                for row in rows.clone() {
                    let elements = lists.range(row);
                    if column.is_null(row) || elements.is_empty() {
                        let is_there = i16::from(is_optional == 1 && !column.is_null(row));
                        self.definition.push(at.definition + is_there);
                        self.repetition.push(repetition(row));
                        continue;
                    }
                    let inside = Place {
                        definition: present + 1,
                        first: repetition(row),
                        depth: at.depth + 1,
                    };
                    self.walk(lists.element(), elements, inside, path)?;
                }
            }
            Values::Struct(members) => {
                if column.has_nulls() {
                    return Err(ParquetError::General(format!(
                        "a structure `{}` is null",
                        column.name
                    )));
                }
                let (member, rest) = member_of(members, path)?;
                let at = Place {
                    definition: present,
                    ..at
                };
                self.walk(member, rows, at, rest)?;
            }
            _ => {
                if self.has_repetition {
                    self.repetition.extend(rows.clone().map(repetition));
                }
                if !self.has_definition {
                    return Ok(());
                }
                match &column.validity {
                    Some(validity) => {
                        let valid = validity[rows].iter();
                        let levels = valid.map(|valid| at.definition + i16::from(*valid));
                        self.definition.extend(levels);
                    }
                    None => self
                        .definition
                        .extend(std::iter::repeat_n(present, rows.len())),
                }
            }
        }
        Ok(())
    }

    /// Finds the leaf below a node, also if no row leads there, and which levels it has.
    fn find(&mut self, node: &'a Column, path: &[usize]) -> Result<()> {
        let (mut node, mut path) = (node, path);
        loop {
            self.has_definition |= node.validity.is_some();
            node = match &node.values {
                Values::List(lists) => {
                    self.has_repetition = true;
                    self.has_definition = true;
                    lists.element()
                }
                Values::Struct(members) => {
                    let (member, rest) = member_of(members, path)?;
                    path = rest;
                    member
                }
                _ => break,
            };
        }
        self.column = node;
        Ok(())
    }

    fn write(&self, writer: &mut SerializedColumnWriter<'_>) -> Result<()> {
        match &self.column.values {
            Values::Bool(v) => self.put::<BoolType>(writer, v),
            Values::I32(v) => self.put::<Int32Type>(writer, v),
            Values::U32(v) => {
                let values: Vec<i32> = v.iter().map(|v| v.cast_signed()).collect();
                self.put::<Int32Type>(writer, &values)
            }
            Values::I64(v) => self.put::<Int64Type>(writer, v),
            Values::U64(v) => {
                let values: Vec<i64> = v.iter().map(|v| v.cast_signed()).collect();
                self.put::<Int64Type>(writer, &values)
            }
            Values::F32(v) => self.put::<FloatType>(writer, v),
            Values::F64(v) => self.put::<DoubleType>(writer, v),
            Values::Text(v) => {
                let values: Vec<ByteArray> = v.iter().map(|v| v.as_str().into()).collect();
                self.put::<ByteArrayType>(writer, &values)
            }
            Values::List(_) | Values::Struct(_) => Err(ParquetError::General(format!(
                "column `{}` has no leaf",
                self.column.name
            ))),
        }
    }

    fn put<T: DataType>(
        &self,
        writer: &mut SerializedColumnWriter<'_>,
        values: &[T::T],
    ) -> Result<()> {
        // Only values that are there are stored.
        let values: Cow<'_, [T::T]> = match &self.column.validity {
            Some(validity) => {
                let valid = values.iter().zip(validity).filter(|(_, valid)| **valid);
                Cow::Owned(valid.map(|(value, _)| value.clone()).collect())
            }
            None => Cow::Borrowed(values),
        };
        writer.typed::<T>().write_batch(
            &values,
            self.has_definition.then_some(&self.definition),
            self.has_repetition.then_some(&self.repetition),
        )?;
        Ok(())
    }
}

/// Where the rows of a node are: the definition level above it, the repetition level of its first row and of the others.
#[derive(Clone, Copy)]
struct Place {
    definition: i16,
    first: i16,
    depth: i16,
}

fn member_of<'a, 'b>(
    members: &'a [Column],
    path: &'b [usize],
) -> Result<(&'a Column, &'b [usize])> {
    let member = path.split_first().and_then(|(i, rest)| {
        let member = members.get(*i)?;
        Some((member, rest))
    });
    member.ok_or_else(|| ParquetError::General("no such member".into()))
}

/// Reads the columns of a file, some rows at a time.
pub(super) struct TableReader {
    path: PathBuf,
    file: SerializedFileReader<File>,
    columns: Vec<Node>,
    /// Row group that is read next.
    next_group: usize,
    open: Option<OpenGroup>,
    batch_rows: usize,
}

/// A row group that is being read.
struct OpenGroup {
    left_rows: usize,
    /// A reader for every leaf of the columns, in their order.
    leaves: Vec<ColumnReader>,
}

impl TableReader {
    /// Reads those columns of a file that `is_wanted`, at most `batch_rows` rows at a time.
    ///
    /// # Errors
    /// A wanted column of a type that is not read.
    pub(super) fn new(
        path: &Path,
        file: SerializedFileReader<File>,
        batch_rows: usize,
        is_wanted: impl Fn(&str) -> bool,
    ) -> std::result::Result<Self, DatasetError> {
        let schema = file.metadata().file_metadata().schema_descr();
        let mut next_leaf = 0;
        let mut columns: Vec<Node> = Vec::new();
        for field in schema.root_schema().get_fields() {
            let n_leaves = n_leaves_of(field);
            if is_wanted(field.name()) && !columns.iter().any(|c| c.name == field.name()) {
                let node = Node::of(field, &mut next_leaf.clone());
                columns.push(node.map_err(|found| DatasetError::Column {
                    path: path.into(),
                    column: field.name().into(),
                    expected: "numbers, booleans, text, or lists or structures of them".into(),
                    found,
                })?);
            }
            next_leaf += n_leaves;
        }
        Ok(Self {
            path: path.into(),
            file,
            columns,
            next_group: 0,
            open: None,
            batch_rows,
        })
    }

    /// The columns without rows.
    pub(super) fn no_rows(&self) -> Table {
        let columns = self.columns.iter().map(Node::without_rows);
        Table {
            columns: columns.collect(),
            metadata: Vec::new(),
        }
    }

    /// The metadata of the file.
    pub(super) fn metadata(&self) -> Vec<(String, String)> {
        let metadata = self.file.metadata().file_metadata().key_value_metadata();
        let pairs = metadata.into_iter().flatten();
        pairs
            .filter_map(|kv| Some((kv.key.clone(), kv.value.clone()?)))
            .collect()
    }

    /// Rows of the file, as it states.
    pub(super) fn n_rows(&self) -> u64 {
        let n_rows = self.file.metadata().file_metadata().num_rows();
        u64::try_from(n_rows).unwrap_or_default()
    }

    /// The next rows, without metadata; `None` at the end.
    pub(super) fn next_batch(&mut self) -> std::result::Result<Option<Table>, DatasetError> {
        let path = self.path.clone();
        guard::isolated(&path, || {
            let batch = self.advance();
            batch.map_err(|e| DatasetError::corrupt(&path, e))
        })
    }

    fn advance(&mut self) -> Result<Option<Table>> {
        loop {
            if let Some(group) = &mut self.open
                && group.left_rows > 0
            {
                let n = group.left_rows.min(self.batch_rows);
                group.left_rows -= n;
                return self.read(n).map(Some);
            }
            if self.next_group >= self.file.num_row_groups() {
                return Ok(None);
            }
            let group = self.file.get_row_group(self.next_group)?;
            let mut leaves = Vec::new();
            for column in &self.columns {
                for leaf in column.leaves() {
                    leaves.push(group.get_column_reader(leaf)?);
                }
            }
            self.open = Some(OpenGroup {
                left_rows: usize::try_from(group.metadata().num_rows()).unwrap_or_default(),
                leaves,
            });
            self.next_group += 1;
        }
    }

    fn read(&mut self, n: usize) -> Result<Table> {
        let mut columns = Vec::with_capacity(self.columns.len());
        let mut readers = self.open.iter_mut().flat_map(|group| &mut group.leaves);
        for node in &self.columns {
            let mut entries = Vec::new();
            for (_, reader) in node.leaves().zip(&mut readers) {
                entries.push(Entries::read(reader, n)?);
            }
            let column = node.assemble(0, 0, &mut entries)?;
            if column.len() != n {
                return Err(ParquetError::General(format!(
                    "column `{}`: {} of {n} rows",
                    node.name,
                    column.len()
                )));
            }
            columns.push(column);
        }
        Ok(Table {
            columns,
            metadata: Vec::new(),
        })
    }
}

fn n_leaves_of(field: &Type) -> usize {
    match field.is_primitive() {
        true => 1,
        false => field.get_fields().iter().map(|f| n_leaves_of(f)).sum(),
    }
}

/// A node of the schema of a file.
struct Node {
    name: String,
    is_optional: bool,
    kind: Kind,
}

enum Kind {
    /// A leaf, with its number in the schema.
    Leaf(usize, LeafType),
    List(Box<Node>),
    Struct(Vec<Node>),
}

#[derive(Clone, Copy)]
enum LeafType {
    Bool,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
    Text,
}

impl Node {
    /// The node of a type; an error names a type that is not read. `next_leaf` counts leaves.
    fn of(field: &Type, next_leaf: &mut usize) -> std::result::Result<Self, String> {
        let info = field.get_basic_info();
        let node = |kind: Kind| Self {
            name: field.name().into(),
            is_optional: field.is_optional(),
            kind,
        };
        if info.has_repetition() && info.repetition() == Repetition::REPEATED {
            return Err("a repeated field without a list".into());
        }
        if field.is_primitive() {
            let leaf = *next_leaf;
            *next_leaf += 1;
            return Ok(node(Kind::Leaf(leaf, leaf_type(field)?)));
        }
        let is_list = info.converted_type() == ConvertedType::LIST
            || matches!(info.logical_type_ref(), Some(LogicalType::List));
        let fields = field.get_fields();
        if !is_list {
            let is_plain = info.converted_type() == ConvertedType::NONE
                && info.logical_type_ref().is_none()
                && !fields.is_empty();
            if !is_plain {
                return Err("a group that is neither a list nor a structure".into());
            }
            let members = fields.iter().map(|f| Self::of(f, next_leaf));
            return Ok(node(Kind::Struct(
                members.collect::<std::result::Result<_, _>>()?,
            )));
        }
        let element = match fields {
            [repeated] if repeated.is_group() => match repeated.get_fields() {
                [element] if repeated.get_basic_info().repetition() == Repetition::REPEATED => {
                    Some(element)
                }
                _ => None,
            },
            _ => None,
        };
        let element = element.ok_or("a list of two levels")?;
        Ok(node(Kind::List(Box::new(Self::of(element, next_leaf)?))))
    }

    /// Numbers of the leaves.
    fn leaves(&self) -> Box<dyn Iterator<Item = usize> + '_> {
        match &self.kind {
            Kind::Leaf(leaf, _) => Box::new(std::iter::once(*leaf)),
            Kind::List(element) => element.leaves(),
            Kind::Struct(members) => Box::new(members.iter().flat_map(Self::leaves)),
        }
    }

    fn without_rows(&self) -> Column {
        let values = match &self.kind {
            Kind::Leaf(_, kind) => kind.no_values(),
            Kind::List(element) => super::table::Offsets::new().lists(element.without_rows()),
            Kind::Struct(members) => {
                Values::Struct(members.iter().map(Self::without_rows).collect())
            }
        };
        Column {
            name: self.name.clone(),
            values,
            validity: self.is_optional.then(Vec::new),
        }
    }

    /// The rows of the node: its entries are those whose repetition level is at most `depth` and whose definition level is at
    /// least `above`, the level at which what is around it is there. `leaves` are the entries of its leaves.
    fn assemble(&self, above: i16, depth: i16, leaves: &mut [Entries]) -> Result<Column> {
        let bad = |problem: &str| ParquetError::General(format!("`{}`: {problem}", self.name));
        let present = above + i16::from(self.is_optional);
        let Some(first) = leaves.first_mut() else {
            return Err(bad("no values"));
        };
        let mut validity = self.is_optional.then(Vec::new);
        let values = match &self.kind {
            Kind::Leaf(_, kind) => {
                let stored = std::mem::replace(&mut first.values, Stored::Bool(Vec::new()));
                let values = kind.values(stored, &self.name)?;
                match &mut validity {
                    None => values,
                    Some(validity) => {
                        let slots = first.definition.iter().filter(|d| **d >= above);
                        validity.extend(slots.map(|d| *d >= present));
                        let n_valid = validity.iter().filter(|valid| **valid).count();
                        if n_valid != values.len() {
                            return Err(bad("values and levels differ in number"));
                        }
                        spread(values, validity)
                    }
                }
            }
            Kind::List(element) => {
                // Every leaf below has the same lists.
                let (inside, inner_depth) = (present + 1, depth + 1);
                let (mut offsets, mut n) = (Vec::new(), 0);
                for (definition, repetition) in first.levels() {
                    if repetition <= depth && definition >= above {
                        offsets.push(n);
                        if let Some(validity) = &mut validity {
                            validity.push(definition >= present);
                        }
                    }
                    n += usize::from(repetition <= inner_depth && definition >= inside);
                }
                offsets.push(n);
                let element = element.assemble(inside, inner_depth, leaves)?;
                let lists = List::new(offsets, element);
                Values::List(lists.ok_or_else(|| bad("lists and elements differ in number"))?)
            }
            Kind::Struct(members) => {
                let mut columns: Vec<Column> = Vec::with_capacity(members.len());
                let mut rest = leaves;
                for member in members {
                    let (of_member, after) = rest.split_at_mut(member.leaves().count());
                    let is_null = |(definition, repetition): (i16, i16)| {
                        repetition <= depth && definition >= above && definition < present
                    };
                    if of_member.first().is_some_and(|e| e.levels().any(is_null)) {
                        return Err(bad("a structure is null"));
                    }
                    let column = member.assemble(present, depth, of_member)?;
                    if columns.first().is_some_and(|c| c.len() != column.len()) {
                        return Err(bad("members differ in number"));
                    }
                    columns.push(column);
                    rest = after;
                }
                if let Some(validity) = &mut validity {
                    validity.resize(columns.first().map_or(0, Column::len), true);
                }
                Values::Struct(columns)
            }
        };
        Ok(Column {
            name: self.name.clone(),
            values,
            validity,
        })
    }
}

fn leaf_type(field: &Type) -> std::result::Result<LeafType, String> {
    let info = field.get_basic_info();
    let (converted, logical) = (info.converted_type(), info.logical_type_ref());
    use ConvertedType as C;
    let is_unsigned = match logical {
        Some(LogicalType::Integer(int)) => Some(!int.is_signed),
        Some(_) => None,
        None => match converted {
            C::NONE | C::INT_8 | C::INT_16 | C::INT_32 | C::INT_64 => Some(false),
            C::UINT_8 | C::UINT_16 | C::UINT_32 | C::UINT_64 => Some(true),
            _ => None,
        },
    };
    let is_plain = logical.is_none() && converted == C::NONE;
    let is_text = matches!(logical, Some(LogicalType::String)) || converted == C::UTF8;
    match (field.get_physical_type(), is_unsigned) {
        (Physical::BOOLEAN, _) if is_plain => Ok(LeafType::Bool),
        (Physical::INT32, Some(false)) => Ok(LeafType::I32),
        (Physical::INT32, Some(true)) => Ok(LeafType::U32),
        (Physical::INT64, Some(false)) => Ok(LeafType::I64),
        (Physical::INT64, Some(true)) => Ok(LeafType::U64),
        (Physical::FLOAT, _) if is_plain => Ok(LeafType::F32),
        (Physical::DOUBLE, _) if is_plain => Ok(LeafType::F64),
        (Physical::BYTE_ARRAY, _) if is_text => Ok(LeafType::Text),
        (physical, _) => Err(match (logical, converted) {
            (Some(logical), _) => format!("{physical} as {logical:?}"),
            (None, C::NONE) => physical.to_string(),
            (None, converted) => format!("{physical} as {converted}"),
        }),
    }
}

impl LeafType {
    fn no_values(self) -> Values {
        match self {
            Self::Bool => Values::Bool(Vec::new()),
            Self::I32 => Values::I32(Vec::new()),
            Self::U32 => Values::U32(Vec::new()),
            Self::I64 => Values::I64(Vec::new()),
            Self::U64 => Values::U64(Vec::new()),
            Self::F32 => Values::F32(Vec::new()),
            Self::F64 => Values::F64(Vec::new()),
            Self::Text => Values::Text(Vec::new()),
        }
    }

    fn values(self, stored: Stored, name: &str) -> Result<Values> {
        Ok(match (self, stored) {
            (Self::Bool, Stored::Bool(v)) => Values::Bool(v),
            (Self::I32, Stored::Int32(v)) => Values::I32(v),
            (Self::U32, Stored::Int32(v)) => {
                Values::U32(v.into_iter().map(i32::cast_unsigned).collect())
            }
            (Self::I64, Stored::Int64(v)) => Values::I64(v),
            (Self::U64, Stored::Int64(v)) => {
                Values::U64(v.into_iter().map(i64::cast_unsigned).collect())
            }
            (Self::F32, Stored::Float(v)) => Values::F32(v),
            (Self::F64, Stored::Double(v)) => Values::F64(v),
            (Self::Text, Stored::Bytes(v)) => {
                let texts = v.iter().map(|v| v.as_utf8().map(str::to_string));
                Values::Text(texts.collect::<Result<_>>()?)
            }
            _ => {
                return Err(ParquetError::General(format!(
                    "`{name}`: another type than the schema states"
                )));
            }
        })
    }
}

/// Values as Parquet stores them.
enum Stored {
    Bool(Vec<bool>),
    Int32(Vec<i32>),
    Int64(Vec<i64>),
    Float(Vec<f32>),
    Double(Vec<f64>),
    Bytes(Vec<ByteArray>),
}

/// What a leaf has in some rows. Levels that are always zero are left out.
struct Entries {
    definition: Vec<i16>,
    repetition: Vec<i16>,
    values: Stored,
}

impl Entries {
    fn read(reader: &mut ColumnReader, n_rows: usize) -> Result<Self> {
        let (mut definition, mut repetition) = (Vec::new(), Vec::new());
        let levels = (&mut definition, &mut repetition);
        let values = match reader {
            ColumnReader::BoolColumnReader(r) => Stored::Bool(take(r, n_rows, levels)?),
            ColumnReader::Int32ColumnReader(r) => Stored::Int32(take(r, n_rows, levels)?),
            ColumnReader::Int64ColumnReader(r) => Stored::Int64(take(r, n_rows, levels)?),
            ColumnReader::FloatColumnReader(r) => Stored::Float(take(r, n_rows, levels)?),
            ColumnReader::DoubleColumnReader(r) => Stored::Double(take(r, n_rows, levels)?),
            ColumnReader::ByteArrayColumnReader(r) => Stored::Bytes(take(r, n_rows, levels)?),
            _ => return Err(ParquetError::General("a type that is not read".into())),
        };
        Ok(Self {
            definition,
            repetition,
            values,
        })
    }

    /// Definition and repetition level of each entry.
    fn levels(&self) -> impl Iterator<Item = (i16, i16)> {
        let repetition = self.repetition.iter().copied();
        // Without lists, every entry is a row.
        let repetition = repetition.chain(std::iter::repeat(0));
        self.definition.iter().copied().zip(repetition)
    }
}

fn take<T: DataType>(
    reader: &mut ColumnReaderImpl<T>,
    n_rows: usize,
    (definition, repetition): (&mut Vec<i16>, &mut Vec<i16>),
) -> Result<Vec<T::T>> {
    let mut values = Vec::new();
    let (n, _, _) = reader.read_records(n_rows, Some(definition), Some(repetition), &mut values)?;
    match n == n_rows {
        true => Ok(values),
        false => Err(ParquetError::General(format!("{n} of {n_rows} rows"))),
    }
}

/// Puts values where rows are valid.
fn spread(values: Values, validity: &[bool]) -> Values {
    fn at<T: Default>(values: Vec<T>, validity: &[bool]) -> Vec<T> {
        let mut values = values.into_iter();
        let rows = validity.iter().map(|valid| match valid {
            true => values.next().unwrap_or_default(),
            false => T::default(),
        });
        rows.collect()
    }
    match values {
        Values::Bool(v) => Values::Bool(at(v, validity)),
        Values::I32(v) => Values::I32(at(v, validity)),
        Values::U32(v) => Values::U32(at(v, validity)),
        Values::I64(v) => Values::I64(at(v, validity)),
        Values::U64(v) => Values::U64(at(v, validity)),
        Values::F32(v) => Values::F32(at(v, validity)),
        Values::F64(v) => Values::F64(at(v, validity)),
        Values::Text(v) => Values::Text(at(v, validity)),
        Values::List(_) | Values::Struct(_) => values,
    }
}

#[cfg(test)]
mod tests {
    use super::super::table::Offsets;
    use super::*;

    fn offsets(lengths: &[usize]) -> Offsets {
        let mut offsets = Offsets::new();
        lengths.iter().for_each(|n| offsets.push(*n));
        offsets
    }

    /// Every kind of nesting: nothing in lists, in lists of lists and in optional values, at the beginning and at the end.
    fn table() -> Table {
        let words = ["", "a", "bc", "\u{e4}"].map(String::from).to_vec();
        let inner = Column::element(
            offsets(&[0, 2, 0, 1]).lists(Column::element(Values::F32(vec![1.0, 2.0, 3.0]))),
        );
        let members = vec![
            Column::new("id", Values::U32(vec![7, u32::MAX])),
            Column::nullable("z", Values::F32(vec![0.0, 0.5]), vec![false, true]),
            Column::new(
                "texts",
                offsets(&[1, 0]).lists(Column::element(Values::Text(vec!["x".into()]))),
            ),
        ];
        let columns = vec![
            Column::new("u", Values::U64(vec![0, u64::MAX, 1, 2, 3])),
            Column::nullable(
                "i",
                Values::I64(vec![-1, 0, i64::MIN, 0, 4]),
                vec![true, false, true, false, true],
            ),
            Column::new(
                "words",
                offsets(&[0, 1, 3, 0, 0]).lists(Column::element(Values::Text(words))),
            ),
            Column::new("nested", offsets(&[0, 3, 0, 1, 0]).lists(inner)),
            Column::nullable(
                "structs",
                offsets(&[0, 1, 0, 0, 1]).lists(Column::element(Values::Struct(members))),
                vec![false, true, true, false, true],
            ),
            Column::nullable(
                "flag",
                Values::Bool(vec![true, false, false, true, false]),
                vec![true, true, false, true, false],
            ),
        ];
        Table {
            columns,
            metadata: vec![("key".into(), "value".into())],
        }
    }

    fn write(path: &Path, tables: &[Table]) {
        let file = File::create(path).unwrap();
        let mut writer = TableWriter::new(file, &tables[0], WriterProperties::default()).unwrap();
        for (key, value) in &tables[0].metadata {
            writer.add_metadata(key, value.clone());
        }
        tables.iter().for_each(|table| writer.write(table).unwrap());
        writer.close().unwrap();
    }

    fn open(path: &Path, batch_rows: usize) -> TableReader {
        let limits = guard::Limits {
            file_bytes: 1 << 20,
            rows: 1000,
            chunk_values: 1000,
        };
        let file = guard::open(path, limits).unwrap();
        TableReader::new(path, file, batch_rows, |name| name != "words").unwrap()
    }

    fn without_words(mut table: Table) -> Table {
        table.columns.retain(|column| column.name != "words");
        table.metadata.clear();
        table
    }

    #[test]
    fn nested_columns_come_back() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.parquet");
        let no_rows = {
            write(&path, &[table()]);
            open(&path, 5).no_rows()
        };
        assert_eq!(no_rows.n_rows(), 0);
        write(&path, &[table(), table()]);
        let mut reader = open(&path, 5);
        assert_eq!(reader.n_rows(), 10);
        assert_eq!(reader.metadata(), table().metadata);
        for _ in 0..2 {
            assert_eq!(
                reader.next_batch().unwrap().unwrap(),
                without_words(table())
            );
        }
        assert_eq!(reader.next_batch().unwrap(), None);
    }

    /// Rows one by one are those of the whole.
    #[test]
    fn batches_are_pieces_of_a_row_group() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.parquet");
        write(&path, &[table()]);
        let mut reader = open(&path, 1);
        let whole = without_words(table());
        let mut nested = Vec::new();
        for row in 0..5 {
            let one = reader.next_batch().unwrap().unwrap();
            assert_eq!(one.n_rows(), 1);
            for (piece, column) in one.columns.iter().zip(&whole.columns) {
                assert_eq!(piece.is_null(0), column.is_null(row), "{}", column.name);
            }
            let lists = one.column("nested").unwrap().as_list().unwrap().clone();
            nested.push(lists.element().len());
        }
        assert_eq!(nested, [0, 3, 0, 1, 0]);
        assert_eq!(reader.next_batch().unwrap(), None);
    }
}
