//! Columns of a table in memory: what Parquet files hold (`levels.rs`), and what bindings hand to Arrow libraries.

/// A table: columns of the same length, and what is stated of the whole.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// The columns.
    pub columns: Vec<Column>,
    /// Names and values of metadata.
    pub metadata: Vec<(String, String)>,
}

/// Values with a name.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Name in its table or structure; `element` in lists.
    pub name: String,
    /// The values, with one of no meaning where there is none.
    pub values: Values,
    /// Which rows have a value; `None` if the column cannot lack any.
    pub validity: Option<Vec<bool>>,
}

/// Values of one type.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Booleans.
    Bool(Vec<bool>),
    /// Integers.
    I32(Vec<i32>),
    /// Integers.
    U32(Vec<u32>),
    /// Integers.
    I64(Vec<i64>),
    /// Integers.
    U64(Vec<u64>),
    /// Floating-point numbers.
    F32(Vec<f32>),
    /// Floating-point numbers.
    F64(Vec<f64>),
    /// Texts.
    Text(Vec<String>),
    /// Lists of elements.
    List(List),
    /// Structures, as a column for each member.
    Struct(Vec<Column>),
}

/// A column of lists: the elements of all rows one after the other, and where each row begins.
#[derive(Clone, Debug, PartialEq)]
pub struct List {
    offsets: Vec<usize>,
    element: Box<Column>,
    length: Option<usize>,
}

impl Table {
    /// Number of rows.
    pub fn n_rows(&self) -> usize {
        self.columns.first().map_or(0, Column::len)
    }

    /// The first column of a name.
    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|column| column.name == name)
    }
}

impl Column {
    /// A column in which every row has a value.
    pub fn new(name: &str, values: Values) -> Self {
        Self {
            name: name.into(),
            values,
            validity: None,
        }
    }

    /// The elements of a list, each of which has a value.
    pub fn element(values: Values) -> Self {
        Self::new("element", values)
    }

    /// A column with values where `validity` says so.
    pub fn nullable(name: &str, values: Values, validity: Vec<bool>) -> Self {
        Self {
            name: name.into(),
            values,
            validity: Some(validity),
        }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether a row has no value.
    pub fn is_null(&self, row: usize) -> bool {
        let validity = self.validity.as_ref();
        validity.is_some_and(|v| v.get(row).is_none_or(|valid| !valid))
    }

    /// Whether any row has no value.
    pub fn has_nulls(&self) -> bool {
        let validity = self.validity.as_ref();
        validity.is_some_and(|v| v.iter().any(|valid| !valid))
    }

    /// The type in words.
    pub fn type_name(&self) -> String {
        match &self.values {
            Values::Bool(_) => "boolean".into(),
            Values::I32(_) => "32-bit integer".into(),
            Values::U32(_) => "32-bit unsigned integer".into(),
            Values::I64(_) => "64-bit integer".into(),
            Values::U64(_) => "64-bit unsigned integer".into(),
            Values::F32(_) => "32-bit float".into(),
            Values::F64(_) => "64-bit float".into(),
            Values::Text(_) => "text".into(),
            Values::List(lists) => {
                let element = lists.element.type_name();
                match lists.length {
                    Some(n) => format!("list of {n} elements ({element})"),
                    None => format!("list ({element})"),
                }
            }
            Values::Struct(members) => {
                let members = members
                    .iter()
                    .map(|m| format!("{} {}", m.name, m.type_name()));
                format!("structure ({})", members.collect::<Vec<_>>().join(", "))
            }
        }
    }

    /// Lists, if these are the values.
    pub fn as_list(&self) -> Option<&List> {
        match &self.values {
            Values::List(lists) => Some(lists),
            _ => None,
        }
    }

    /// Booleans, if these are the values.
    pub fn as_bool(&self) -> Option<&[bool]> {
        match &self.values {
            Values::Bool(values) => Some(values),
            _ => None,
        }
    }

    /// 32-bit unsigned integers, if these are the values.
    pub fn as_u32(&self) -> Option<&[u32]> {
        match &self.values {
            Values::U32(values) => Some(values),
            _ => None,
        }
    }

    /// 64-bit unsigned integers, if these are the values.
    pub fn as_u64(&self) -> Option<&[u64]> {
        match &self.values {
            Values::U64(values) => Some(values),
            _ => None,
        }
    }

    /// 64-bit floats, if these are the values.
    pub fn as_f64(&self) -> Option<&[f64]> {
        match &self.values {
            Values::F64(values) => Some(values),
            _ => None,
        }
    }

    /// 32-bit floats, if these are the values.
    pub fn as_f32(&self) -> Option<&[f32]> {
        match &self.values {
            Values::F32(values) => Some(values),
            _ => None,
        }
    }

    /// Texts, if these are the values.
    pub fn as_text(&self) -> Option<&[String]> {
        match &self.values {
            Values::Text(values) => Some(values),
            _ => None,
        }
    }
}

impl Values {
    /// Number of rows.
    pub fn len(&self) -> usize {
        match self {
            Self::Bool(v) => v.len(),
            Self::I32(v) => v.len(),
            Self::U32(v) => v.len(),
            Self::I64(v) => v.len(),
            Self::U64(v) => v.len(),
            Self::F32(v) => v.len(),
            Self::F64(v) => v.len(),
            Self::Text(v) => v.len(),
            Self::List(lists) => lists.n_rows(),
            Self::Struct(members) => members.first().map_or(0, Column::len),
        }
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl List {
    /// Lists whose row i has the elements from `offsets[i]` to `offsets[i + 1]`; `None` unless the offsets begin with 0, never
    /// decrease and end with the number of elements.
    pub fn new(offsets: Vec<usize>, element: Column) -> Option<Self> {
        let fits = offsets.first() == Some(&0)
            && offsets.is_sorted()
            && offsets.last() == Some(&element.len());
        fits.then(|| Self {
            offsets,
            element: Box::new(element),
            length: None,
        })
    }

    /// Lists of `length` elements each; `None` unless the elements are those of whole lists.
    pub fn of_length(length: usize, element: Column) -> Option<Self> {
        let n = element.len();
        if length == 0 || !n.is_multiple_of(length) {
            return None;
        }
        let lists = Self::new((0..=n).step_by(length).collect(), element)?;
        Some(Self {
            length: Some(length),
            ..lists
        })
    }

    /// Number of lists.
    pub fn n_rows(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Where each row begins, and the number of elements.
    pub fn offsets(&self) -> &[usize] {
        &self.offsets
    }

    /// The elements of a row, as places in [`Self::element`].
    pub fn range(&self, row: usize) -> std::ops::Range<usize> {
        self.offsets[row]..self.offsets[row + 1]
    }

    /// The elements of all rows.
    pub fn element(&self) -> &Column {
        &self.element
    }

    /// The number of elements that every row has, if it is part of the type.
    pub fn length(&self) -> Option<usize> {
        self.length
    }

    /// The same lists of other elements of the same number, with `length` as part of the type, which must be that of every row.
    pub(super) fn map_element(
        self,
        length: Option<usize>,
        to: impl FnOnce(Column) -> Column,
    ) -> Self {
        Self {
            offsets: self.offsets,
            element: Box::new(to(*self.element)),
            length,
        }
    }

    /// The offsets and the elements.
    pub fn into_parts(self) -> (Vec<usize>, Column) {
        (self.offsets, *self.element)
    }

    /// Whether every row has so many elements.
    pub fn all_have(&self, length: usize) -> bool {
        self.length == Some(length) || self.offsets.windows(2).all(|w| w[1] - w[0] == length)
    }
}

/// Builds the offsets of lists.
#[derive(Clone, Debug)]
pub(super) struct Offsets(Vec<usize>);

impl Offsets {
    pub(super) fn new() -> Self {
        Self(vec![0])
    }

    /// Adds a row of `n` elements.
    pub(super) fn push(&mut self, n: usize) {
        let end = self.0.last().copied().unwrap_or_default();
        self.0.push(end + n);
    }

    /// The lists. The number of elements must be the sum of what was pushed.
    pub(super) fn lists(self, element: Column) -> Values {
        debug_assert_eq!(self.0.last().copied(), Some(element.len()));
        Values::List(List {
            offsets: self.0,
            element: Box::new(element),
            length: None,
        })
    }
}
