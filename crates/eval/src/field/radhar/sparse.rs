//! Rows of which nearly all values are zero, and their scalar products.

/// A matrix of sparse rows.
#[derive(Clone, Debug, PartialEq)]
pub struct SparseRows {
    n_columns: usize,
    /// Start of each row in `columns`, and the end of the last one.
    starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f32>,
}

impl SparseRows {
    /// A matrix without rows. Columns are below 2^32.
    pub fn new(n_columns: usize) -> Self {
        Self {
            n_columns,
            starts: vec![0],
            columns: Vec::new(),
            values: Vec::new(),
        }
    }

    /// Adds a row of values by column; a column occurs at most once in it.
    pub fn push(&mut self, entries: impl IntoIterator<Item = (usize, f32)>) {
        for (column, value) in entries {
            debug_assert!(column < self.n_columns);
            self.columns.push(column as u32);
            self.values.push(value);
        }
        self.starts.push(self.columns.len());
    }

    /// Adds the rows of a matrix of the same width.
    pub fn append(&mut self, other: &Self) {
        debug_assert_eq!(self.n_columns, other.n_columns);
        let offset = self.columns.len();
        self.starts
            .extend(other.starts.iter().skip(1).map(|start| offset + start));
        self.columns.extend_from_slice(&other.columns);
        self.values.extend_from_slice(&other.values);
    }

    /// Number of rows.
    pub fn n_rows(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of stored values.
    pub fn n_stored(&self) -> usize {
        self.values.len()
    }

    /// Columns and values of a row.
    pub fn row(&self, row: usize) -> (&[u32], &[f32]) {
        let range = self.starts[row]..self.starts[row + 1];
        (&self.columns[range.clone()], &self.values[range])
    }

    /// Scalar products of all pairs of rows.
    ///
    /// Work: for every column, the square of the number of rows that have a value in it. Memory: 8 bytes a pair of rows.
    pub fn gram(&self) -> Gram {
        let n = self.n_rows();
        // The entries by column (counting sort).
        let mut starts = vec![0_usize; self.n_columns + 1];
        for column in &self.columns {
            starts[*column as usize + 1] += 1;
        }
        for column in 0..self.n_columns {
            starts[column + 1] += starts[column];
        }
        let mut free = starts.clone();
        let mut entries = vec![(0_u32, 0.0_f32); self.n_stored()];
        for row in 0..n {
            let (columns, values) = self.row(row);
            for (column, value) in columns.iter().zip(values) {
                let place = &mut free[*column as usize];
                entries[*place] = (row as u32, *value);
                *place += 1;
            }
        }
        let mut products = vec![0.0; n * n];
        for range in starts.windows(2) {
            let column = &entries[range[0]..range[1]];
            for (i, (row, value)) in column.iter().enumerate() {
                let products = &mut products[*row as usize * n..][..n];
                // Rows of a column are in order, so that this is the lower triangle.
                for (other, other_value) in &column[..=i] {
                    products[*other as usize] += f64::from(*value) * f64::from(*other_value);
                }
            }
        }
        for row in 0..n {
            for other in 0..row {
                products[other * n + row] = products[row * n + other];
            }
        }
        Gram { n, products }
    }
}

/// Scalar products of all pairs of rows: everything that principal components and kernels of distances need.
#[derive(Clone, Debug, PartialEq)]
pub struct Gram {
    n: usize,
    products: Vec<f64>,
}

impl Gram {
    /// Number of rows.
    pub fn n_rows(&self) -> usize {
        self.n
    }

    /// Scalar product of two rows.
    pub fn product(&self, a: usize, b: usize) -> f64 {
        self.products[a * self.n + b]
    }

    /// Scalar products of a row with all rows.
    pub fn row(&self, row: usize) -> &[f64] {
        &self.products[row * self.n..][..self.n]
    }

    /// Squared Euclidean distance of two rows.
    pub fn squared_distance(&self, a: usize, b: usize) -> f64 {
        (self.product(a, a) + self.product(b, b) - 2.0 * self.product(a, b)).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_those_of_the_dense_rows() {
        let dense = [
            [1.0, 0.0, 2.0, 0.0],
            [0.0, 3.0, 0.0, 0.0],
            [0.5, 0.0, 0.0, -1.0],
            [0.0, 0.0, 0.0, 0.0],
        ];
        let mut rows = SparseRows::new(4);
        for row in dense {
            let entries = row.into_iter().enumerate();
            rows.push(entries.filter(|(_, value)| *value != 0.0));
        }
        let mut twice = rows.clone();
        twice.append(&rows);
        assert_eq!((twice.n_rows(), twice.n_stored()), (8, 10));
        let gram = twice.gram();
        for a in 0..8 {
            for b in 0..8 {
                let pairs = || dense[a % 4].iter().zip(dense[b % 4]);
                let product: f32 = pairs().map(|(x, y)| x * y).sum();
                let squared: f32 = pairs().map(|(x, y)| (x - y) * (x - y)).sum();
                assert_eq!(gram.product(a, b), f64::from(product));
                assert_eq!(gram.row(a)[b], f64::from(product));
                assert_eq!(gram.squared_distance(a, b), f64::from(squared));
            }
        }
    }
}
