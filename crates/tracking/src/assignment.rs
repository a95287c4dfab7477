//! Linear assignment: one column for each row, at the minimum total cost.

/// Solves the linear assignment problem: assigns every row to a column of its own so that the sum of costs is minimal.
/// The method is Kuhn's Hungarian method with potentials and shortest augmenting paths, O(rows^2 columns) (Jonker and
/// Volgenant, Computing 38, 1987).
///
/// - `costs`: `[row, column]`, finite, with at least as many columns as rows
/// - returns: the column of each row
///
/// # Panics
/// If `costs` is not a rectangle with at least as many columns as rows.
pub fn assign(costs: &[Vec<f64>]) -> Vec<usize> {
    let n_rows = costs.len();
    let n_cols = costs.first().map_or(0, Vec::len);
    assert!(n_rows <= n_cols && costs.iter().all(|row| row.len() == n_cols));
    // Column 0 is a virtual start column. Rows and columns count from 1.
    let mut row_potential = vec![0.0; n_rows + 1];
    let mut col_potential = vec![0.0; n_cols + 1];
    let mut row_of = vec![0; n_cols + 1];
    for row in 1..=n_rows {
        let mut before = vec![0; n_cols + 1];
        let mut distance = vec![f64::INFINITY; n_cols + 1];
        let mut done = vec![false; n_cols + 1];
        row_of[0] = row;
        let mut col = 0;
        while row_of[col] != 0 {
            done[col] = true;
            let here = row_of[col];
            let (mut step, mut next) = (f64::INFINITY, 0);
            for to in 1..=n_cols {
                if done[to] {
                    continue;
                }
                let reduced = costs[here - 1][to - 1] - row_potential[here] - col_potential[to];
                if reduced < distance[to] {
                    distance[to] = reduced;
                    before[to] = col;
                }
                if distance[to] < step {
                    step = distance[to];
                    next = to;
                }
            }
            for to in 0..=n_cols {
                if done[to] {
                    row_potential[row_of[to]] += step;
                    col_potential[to] -= step;
                } else {
                    distance[to] -= step;
                }
            }
            col = next;
        }
        while col != 0 {
            row_of[col] = row_of[before[col]];
            col = before[col];
        }
    }
    let mut columns = vec![0; n_rows];
    for (col, row) in row_of.iter().enumerate().skip(1) {
        if *row > 0 {
            columns[row - 1] = col - 1;
        }
    }
    columns
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Minimum cost of assigning the rows from `row` on, found by exhaustive search.
    fn best(costs: &[Vec<f64>], row: usize, taken: &mut Vec<bool>) -> f64 {
        if row == costs.len() {
            return 0.0;
        }
        let mut min = f64::INFINITY;
        for col in 0..taken.len() {
            if !taken[col] {
                taken[col] = true;
                min = min.min(costs[row][col] + best(costs, row + 1, taken));
                taken[col] = false;
            }
        }
        min
    }

    #[test]
    fn costs_as_little_as_the_best_of_all_permutations() {
        let mut state = 1_u64;
        let mut random = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            state >> 33
        };
        for trial in 0..400 {
            let n_rows = random() as usize % 6;
            let n_cols = n_rows + random() as usize % 3;
            let costs: Vec<Vec<f64>> = (0..n_rows)
                // Every other trial has few distinct values, so that ties occur. Some values are negative.
                .map(|_| {
                    let max = if trial % 2 == 0 { 4 } else { 1000 };
                    (0..n_cols).map(|_| (random() % max) as f64 - 1.5).collect()
                })
                .collect();
            let columns = assign(&costs);
            let mut distinct = columns.clone();
            distinct.sort_unstable();
            distinct.dedup();
            assert_eq!(distinct.len(), n_rows, "{columns:?}");
            let found: f64 = columns.iter().zip(&costs).map(|(c, row)| row[*c]).sum();
            let expected = best(&costs, 0, &mut vec![false; n_cols]);
            // Sums of halves are exact.
            assert_eq!(found, expected, "{costs:?}");
        }
    }
}
