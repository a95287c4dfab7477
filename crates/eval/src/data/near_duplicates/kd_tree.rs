//! A k-d tree: the nearest of many points, found without looking at them all.

use std::collections::BinaryHeap;

use super::sketch::DIM;

/// A k-d tree over points, all in memory.
pub(super) struct KdTree {
    points: Vec<[f32; DIM]>,
    /// Points of node ranges, halved at every level.
    order: Vec<u32>,
    /// Where each node is cut; the halves of node i are nodes 2 i + 1 and 2 i + 2.
    cuts: Vec<f32>,
}

/// Points that are looked at one by one.
const LEAF: usize = 16;

/// A part of the tree: its points, its number and the axis that it is cut along.
#[derive(Clone, Copy)]
struct Node {
    low: usize,
    high: usize,
    number: usize,
    axis: usize,
}

impl Node {
    fn is_leaf(self) -> bool {
        self.high - self.low <= LEAF
    }

    fn halves(self) -> [Node; 2] {
        let middle = self.low + (self.high - self.low) / 2;
        let half = |low, high, number| Node {
            low,
            high,
            number,
            axis: (self.axis + 1) % DIM,
        };
        [
            half(self.low, middle, 2 * self.number + 1),
            half(middle, self.high, 2 * self.number + 2),
        ]
    }
}

impl KdTree {
    pub(super) fn new(points: Vec<[f32; DIM]>) -> Self {
        let order: Vec<u32> = (0..points.len() as u32).collect();
        let mut tree = Self {
            points,
            order,
            cuts: Vec::new(),
        };
        let mut nodes = vec![tree.root()];
        while let Some(node) = nodes.pop() {
            if node.is_leaf() {
                continue;
            }
            let [left, right] = node.halves();
            let value = |index: u32| tree.points[index as usize][node.axis];
            let (_, middle, _) = tree.order[node.low..node.high]
                .select_nth_unstable_by(left.high - left.low, |&a, &b| {
                    value(a).total_cmp(&value(b))
                });
            let cut = value(*middle);
            if tree.cuts.len() <= node.number {
                tree.cuts.resize(node.number + 1, 0.0);
            }
            tree.cuts[node.number] = cut;
            nodes.extend([left, right]);
        }
        tree
    }

    fn root(&self) -> Node {
        Node {
            low: 0,
            high: self.order.len(),
            number: 0,
            axis: 0,
        }
    }

    /// Indices of the `k` nearest points.
    pub(super) fn nearest(&self, query: &[f32; DIM], k: usize) -> Vec<u32> {
        let mut found = BinaryHeap::with_capacity(k + 1);
        self.visit(query, k, self.root(), &mut found);
        found.into_iter().map(|near: Near| near.index).collect()
    }

    fn visit(&self, query: &[f32; DIM], k: usize, node: Node, found: &mut BinaryHeap<Near>) {
        let worst = |found: &BinaryHeap<Near>| match found.peek() {
            Some(near) if found.len() >= k => near.square,
            _ => f32::INFINITY,
        };
        if node.is_leaf() {
            for &index in &self.order[node.low..node.high] {
                let pairs = query.iter().zip(&self.points[index as usize]);
                let square: f32 = pairs.map(|(a, b)| (a - b) * (a - b)).sum();
                if square < worst(found) {
                    found.push(Near { square, index });
                    if found.len() > k {
                        found.pop();
                    }
                }
            }
            return;
        }
        let beyond = query[node.axis] - self.cuts[node.number];
        let [left, right] = node.halves();
        let (near, far) = if beyond < 0.0 {
            (left, right)
        } else {
            (right, left)
        };
        self.visit(query, k, near, found);
        // Points as far as the cut itself may lie on either side of it.
        if beyond * beyond < worst(found) {
            self.visit(query, k, far, found);
        }
    }
}

/// A neighbour; the farthest is the greatest.
#[derive(PartialEq)]
struct Near {
    square: f32,
    index: u32,
}

impl Eq for Near {}

impl PartialOrd for Near {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Near {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.square.total_cmp(&other.square)).then(self.index.cmp(&other.index))
    }
}

#[cfg(test)]
mod tests {
    use radarllm_base::seed::derive_seed;

    use super::*;

    fn draws(seed: u64) -> impl FnMut() -> f32 {
        let mut n = 0_u64;
        move || {
            n += 1;
            (derive_seed(seed, &n.to_string()) >> 40) as f32 / (1_u64 << 23) as f32 - 1.0
        }
    }

    #[test]
    fn the_tree_finds_what_a_list_finds() {
        let mut draw = draws(1);
        // Few distinct values, so that there are many ties on every axis.
        let points: Vec<[f32; DIM]> = (0..700)
            .map(|_| std::array::from_fn(|_| (draw() * 3.0).round()))
            .collect();
        let tree = KdTree::new(points.clone());
        for _ in 0..50 {
            let query: [f32; DIM] = std::array::from_fn(|_| draw() * 3.0);
            let square = |p: &[f32; DIM]| -> f32 {
                p.iter().zip(&query).map(|(a, b)| (b - a) * (b - a)).sum()
            };
            let mut expected: Vec<f32> = points.iter().map(square).collect();
            expected.sort_by(f32::total_cmp);
            let mut found: Vec<f32> = tree
                .nearest(&query, 20)
                .iter()
                .map(|&i| square(&points[i as usize]))
                .collect();
            found.sort_by(f32::total_cmp);
            assert_eq!(found, expected[..20]);
        }
        assert_eq!(
            KdTree::new(points[..3].to_vec())
                .nearest(&[0.0; DIM], 20)
                .len(),
            3
        );
    }
}
